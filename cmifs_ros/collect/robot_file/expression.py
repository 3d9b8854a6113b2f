# SPDX-License-Identifier: Apache-2.0

"""The expressions of a robot file: arithmetic over named values, without `eval`.

Only the syntax listed here is accepted; the rest of Python is refused when the file is read. All
numbers are floats, so none exceeds 8 bytes. NaN means unknown. It propagates, also through
comparisons, unless the other operands decide the result, as in `nan or 1`.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping

MAX_LENGTH = 1000
MAX_NODES = 200
#: Greatest exponent.
MAX_POWER = 8

_BINARY = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_UNARY: dict[type, Callable[[float], float]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: lambda value: value if math.isnan(value) else not value,
}
_COMPARE = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
FUNCTIONS: dict[str, tuple[Callable[..., float], int]] = {
    'abs': (abs, 1),
    'sqrt': (math.sqrt, 1),
    'exp': (math.exp, 1),
    'hypot': (math.hypot, 2),
    'min': (min, 2),
    'max': (max, 2),
}


class Expression:
    """A parsed expression.

    It may contain numbers, names, `+ - * / **`, comparisons, `and`, `or`, `not`, the functions abs,
    sqrt, exp, hypot, min, max, and `before(name)`, the value at the previous step.

    Parameters
    ----------
    text : str

    Attributes
    ----------
    names : frozenset of str
        The values it needs, including those in `before`.

    Raises
    ------
    ValueError
        If it contains anything else, or is too long.

    """

    def __init__(self, text: str):
        if len(text) > MAX_LENGTH:
            raise ValueError(f'an expression of {len(text)} characters; at most {MAX_LENGTH}')
        try:
            tree = ast.parse(text.strip(), mode='eval').body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise ValueError(
                f'{text!r} is not an expression; expected one such as "a - 2 * b"'
            ) from None
        if sum(1 for _ in ast.walk(tree)) > MAX_NODES:
            raise ValueError(f'an expression of more than {MAX_NODES} parts; split it')
        names: set[str] = set()
        _check(tree, names)
        self.text = text
        self.names = frozenset(names)
        self._tree = tree

    def __call__(self, values: Mapping[str, float], before: Mapping[str, float]) -> float:
        """Return its value; NaN if undefined, such as 1 / 0."""
        try:
            return float(_value(self._tree, values, before))
        except (ArithmeticError, ValueError, TypeError):  # TypeError: a complex root.
            return math.nan


def _check(node: ast.expr, names: set[str]) -> None:  # noqa: PLR0912
    match node:
        case ast.Constant(value=int() | float() as number):
            if abs(number) > 1e300:
                raise ValueError('a number in an expression is beyond 1e300')
        case ast.Name():
            names.add(node.id)
        case ast.BinOp() if type(node.op) in _BINARY:
            if isinstance(node.op, ast.Pow):
                _check_power(node.right)
            _check(node.left, names)
            _check(node.right, names)
        case ast.UnaryOp() if type(node.op) in _UNARY:
            _check(node.operand, names)
        case ast.BoolOp():
            for value in node.values:
                _check(value, names)
        case ast.Compare() if all(type(op) in _COMPARE for op in node.ops):
            for value in (node.left, *node.comparators):
                _check(value, names)
        case ast.Call(func=ast.Name(id='before'), args=[ast.Name(id=name)], keywords=[]):
            names.add(name)
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if (
            name in FUNCTIONS and len(arguments) == FUNCTIONS[name][1]
        ):
            for argument in arguments:
                _check(argument, names)
        case _:
            raise ValueError(
                f'{ast.unparse(node)[:60]!r} is not allowed in an expression; expected '
                f'numbers, names, + - * / **, comparisons, and, or, not, before(name), '
                f'{", ".join(FUNCTIONS)}'
            )


def _check_power(node: ast.expr) -> None:
    if not (
        isinstance(node, ast.Constant)
        and isinstance(node.value, (int, float))
        and node.value <= MAX_POWER
    ):
        raise ValueError(
            f'the exponent {ast.unparse(node)[:60]!r}; expected a number up to {MAX_POWER}'
        )


def _value(node: ast.expr, values: Mapping, before: Mapping):  # noqa: PLR0911
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name():
            return values[node.id]
        case ast.BinOp():
            return _known(
                _BINARY[type(node.op)],
                _value(node.left, values, before),
                _value(node.right, values, before),
            )
        case ast.UnaryOp():
            return _UNARY[type(node.op)](_value(node.operand, values, before))
        case ast.BoolOp():
            parts = [_value(value, values, before) for value in node.values]
            known = [bool(part) for part in parts if not math.isnan(part)]
            decides = isinstance(node.op, ast.Or)
            if decides in known:
                return decides
            return not decides if len(known) == len(parts) else math.nan
        case ast.Compare():
            sides = [_value(side, values, before) for side in (node.left, *node.comparators)]
            if any(map(math.isnan, sides)):
                return math.nan
            return all(
                _COMPARE[type(op)](left, right)
                for op, left, right in zip(node.ops, sides[:-1], sides[1:], strict=True)
            )
        case ast.Call(func=ast.Name(id='before'), args=[ast.Name(id=name)]):
            return before[name]
        case ast.Call(func=ast.Name(id=name)):
            arguments = [_value(argument, values, before) for argument in node.args]
            return _known(FUNCTIONS[name][0], *arguments)


def _known(function: Callable, *arguments: float) -> float:
    """Return NaN if an argument is: `nan ** 0` and `min(1, nan)` are 1 in Python."""
    return math.nan if any(map(math.isnan, arguments)) else function(*arguments)
