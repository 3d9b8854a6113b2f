# SPDX-License-Identifier: Apache-2.0

"""Node parameters: declared from one table, validated, refused with a reason."""

from __future__ import annotations

import difflib
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

#: Parameters that rclpy declares itself, or reads without declaring them.
_OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides')


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
        It can be set only at startup.

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

    A whole number is accepted for a float. A value given at startup for a parameter that does not
    exist causes a warning that names the nearest parameter.

    Parameters
    ----------
    node : Node
    specs : sequence of Spec
    check : callable
        Takes all values by name; raises ValueError if they are invalid together.
    apply : callable
        Called with the changed values by name after a change was accepted.

    Returns
    -------
    dict
        The values by name, updated with every change.

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

    floats = {spec.name for spec in specs if type(spec.default) is float}

    def as_declared(parameters: list[Parameter]) -> list[Parameter]:
        return [
            Parameter(p.name, value=float(p.value))
            if p.name in floats and type(p.value) is int
            else p
            for p in parameters
        ]

    given = node._parameter_overrides  # rclpy itself reports only declared parameters.
    given.update({p.name: p for p in as_declared(list(given.values()))})
    for spec in specs:
        parameter = node.declare_parameter(spec.name, spec.default, spec.descriptor())
        values[spec.name] = parameter.value
    check_all(values)
    warn_of_unknown(node, list(values))
    node.add_pre_set_parameters_callback(as_declared)
    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(accept)
    return values


def warn_of_unknown(node: Node, known: Sequence[str]) -> None:
    """Warn if a node was given parameters that it does not have."""
    names = sorted(node._parameter_overrides.keys() - set(known))
    unknown = [name for name in names if name.split('.')[0] not in _OF_ROS]
    if unknown:
        nearest = difflib.get_close_matches(unknown[0], known, n=1, cutoff=0)
        node.get_logger().warning(
            f'unknown parameters are ignored: {", ".join(unknown[:8])}'
            + (f' and {len(unknown) - 8} more' if len(unknown) > 8 else '')
            + f'; the name nearest to {unknown[0]} is {nearest[0]}'
        )
