"""Parameters of the nodes: declared from one table, refused with a reason."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter


@dataclass(frozen=True)
class Spec:
    """One parameter.

    Attributes
    ----------
    name, description : str
    default : bool, int, float or str
        Its type is the parameter's type.
    limits : pair of numbers, optional
        Least and greatest value.
    choices : sequence of str, optional
        Allowed values.
    read_only : bool
        It can be set at the start only.

    """

    name: str
    default: Any
    description: str
    limits: tuple[float, float] | None = None
    choices: Sequence[str] | None = None
    read_only: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """Return the descriptor that `ros2 param describe` shows."""
        descriptor = ParameterDescriptor(description=self.description, read_only=self.read_only)
        if self.limits is not None and isinstance(self.default, int):
            low, high = self.limits
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
        elif self.limits is not None:
            low, high = map(float, self.limits)
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        if self.choices is not None:
            descriptor.additional_constraints = f'one of: {", ".join(self.choices)}'
        return descriptor


def declare(
    node: Node,
    specs: Sequence[Spec],
    check: Callable[[dict[str, Any]], None],
    apply: Callable[[dict[str, Any]], None],
) -> dict[str, Any]:
    """Declare parameters; validate before each change and apply after it.

    Parameters
    ----------
    node : Node
    specs : sequence of Spec
    check : callable
        Given all values, by name, raises ValueError if they cannot be used together.
    apply : callable
        Called with the changed values, by name, after a change was accepted.

    Returns
    -------
    dict
        The values by name; it follows every change.

    Raises
    ------
    ValueError, InvalidParameterTypeException, InvalidParameterValueException
        If an initial value is refused.

    """
    choices = {spec.name: spec.choices for spec in specs if spec.choices is not None}
    values: dict[str, Any] = {}

    def check_all(changed: dict[str, Any]) -> None:
        for name in choices.keys() & changed.keys():
            if changed[name] not in choices[name]:
                raise ValueError(
                    f'{name} is {changed[name]!r}; expected one of {", ".join(choices[name])}'
                )
        check(values | changed)

    def validate(parameters: list[Parameter]) -> SetParametersResult:
        try:
            check_all({p.name: p.value for p in parameters if p.name in values})
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def accept(parameters: list[Parameter]) -> None:
        changed = {p.name: p.value for p in parameters if p.name in values}
        if changed:
            values.update(changed)
            apply(changed)

    for spec in specs:
        parameter = node.declare_parameter(spec.name, spec.default, spec.descriptor())
        values[spec.name] = parameter.value
    check_all(values)
    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(accept)
    return values
