# SPDX-License-Identifier: Apache-2.0

"""The expressions of a robot file: arithmetic over named values, without `eval`.

Only the syntax listed here is accepted; the rest of Python is refused when the file is read. All
values are floats, so none exceeds 8 bytes. A text is one value for each word that it is compared
with, such as `status.delivered`: 1 if the text is that word, else 0. NaN means unknown. It
propagates, also through comparisons, unless the other operands decide the result, as in `nan or 1`.
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
    sqrt, exp, hypot, min, max, and `before(name)`, the value at the previous step. A text is
    compared with a word in quotes, by `==` or `!=`.

    Parameters
    ----------
    text : str

    Attributes
    ----------
    numbers : frozenset of str
        The values it needs as numbers, including those in `before`.
    words : dict of str to set of str
        The words that each text is compared with.

    Raises
    ------
    ValueError
        If it contains anything else, or is too long.

    """

    def __init__(self, text: str):
        if len(text) > MAX_LENGTH:
            raise ValueError(
                f'an expression of {len(text)} characters; expected at most {MAX_LENGTH}'
            )
        try:
            tree = ast.parse(text.strip(), mode='eval').body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise ValueError(
                f'{text!r} is not an expression; expected one such as "a - 2 * b"'
            ) from None
        if sum(1 for _ in ast.walk(tree)) > MAX_NODES:
            raise ValueError(f'an expression of more than {MAX_NODES} parts; split it')
        numbers: set[str] = set()
        self.words: dict[str, set[str]] = {}
        _check(tree, numbers, self.words)
        self.text = text
        self.numbers = frozenset(numbers)
        self._tree = tree

    def __str__(self) -> str:
        """Return the text."""
        return self.text

    @property
    def names(self) -> frozenset[str]:
        """All that it needs, numbers and texts."""
        return self.numbers | self.words.keys()

    def __call__(self, values: Mapping[str, float], before: Mapping[str, float]) -> float:
        """Return its value; NaN if undefined, such as 1 / 0."""
        try:
            return float(_value(self._tree, values, before))
        except (ArithmeticError, ValueError, TypeError):  # TypeError: a complex root.
            return math.nan


def _check(node: ast.expr, numbers: set[str], words: dict[str, set[str]]) -> None:  # noqa: PLR0912
    parts: list[ast.expr] = []
    match node:
        case ast.Constant(value=int() | float() as number):
            if abs(number) > 1e300:
                raise ValueError('a number in an expression is beyond 1e300')
        case ast.Name():
            numbers.add(node.id)
        case ast.BinOp() if type(node.op) in _BINARY:
            if isinstance(node.op, ast.Pow):
                _check_power(node.right)
            parts = [node.left, node.right]
        case ast.UnaryOp() if type(node.op) in _UNARY:
            parts = [node.operand]
        case ast.BoolOp():
            parts = node.values
        case ast.Compare() if found := _compared_text(node):
            name, word = found
            words.setdefault(_name_of(name), set()).add(word)
        case ast.Compare() if all(type(op) in _COMPARE for op in node.ops):
            parts = [node.left, *node.comparators]
        case ast.Call(func=ast.Name(id='before'), args=[ast.Name(id=name)], keywords=[]):
            numbers.add(name)
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if (
            name in FUNCTIONS and len(arguments) == FUNCTIONS[name][1]
        ):
            parts = arguments
        case ast.Constant(value=str() as text):
            raise ValueError(
                f'the text {text[:40]!r}; expected a comparison by == or !=, as in '
                "status == 'delivered'"
            )
        case _:
            raise ValueError(
                f'{ast.unparse(node)[:60]!r} is not allowed in an expression; expected '
                f'numbers, names, + - * / **, comparisons, and, or, not, before(name), '
                f'{", ".join(FUNCTIONS)}'
            )
    for part in parts:
        _check(part, numbers, words)


def _compared_text(node: ast.Compare) -> tuple[ast.expr, str] | None:
    """Return a name, or `before(name)`, and the word it is compared with, if any."""
    if len(node.ops) > 1 or not isinstance(node.ops[0], (ast.Eq, ast.NotEq)):
        return None
    for name, word in ((node.left, node.comparators[0]), (node.comparators[0], node.left)):
        if _name_of(name) and isinstance(word, ast.Constant) and isinstance(word.value, str):
            return name, word.value
    return None


def _name_of(node: ast.expr) -> str:
    match node:
        case ast.Name(id=name):
            return name
        case ast.Call(func=ast.Name(id='before'), args=[ast.Name(id=name)], keywords=[]):
            return name
    return ''


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
        case ast.Compare() if found := _compared_text(node):
            name, word = found
            of = values if isinstance(name, ast.Name) else before
            is_word = of[f'{_name_of(name)}.{word}']
            return _UNARY[ast.Not](is_word) if isinstance(node.ops[0], ast.NotEq) else is_word
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
