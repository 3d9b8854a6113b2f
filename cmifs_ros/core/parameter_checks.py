# SPDX-License-Identifier: Apache-2.0

"""Checks of the parameters of `ConditionalMISelector`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from numbers import Real
from typing import Any

from .targets import TARGETS


def _is_number(value: Any, least: float = -math.inf) -> bool:
    return isinstance(value, Real) and float(value) >= least


#: What is expected of each parameter, and whether a value is that. (The range of `gamma` is checked
#: with the returns, that of `num_centers` with the kernels.)
_EXPECTED: Mapping[str, tuple[str, Callable[[Any], bool]]] = {
    'target': (f'one of {", ".join(TARGETS)}', TARGETS.__contains__),
    'gamma': ('a number', _is_number),
    'max_time_bins': (
        "at least 1, None for no bins, or 'auto'",
        lambda value: value in (None, 'auto') or _is_number(value, 1),
    ),
    'tuning_window': ('a number, at least 0', lambda value: _is_number(value, 0)),
    'num_centers': ('a number or None', lambda value: value is None or _is_number(value)),
    'significance': ('0 < significance < 1', lambda value: _is_number(value) and 0 < value < 1),
    'margin': ('0 < margin < 1', lambda value: _is_number(value) and 0 < value < 1),
    'n_jobs': ('a number, at least 1', lambda value: _is_number(value, 1)),
}


def check_parameters(parameters: Mapping[str, Any]) -> None:
    """Check the parameters by their names.

    Raises
    ------
    ValueError
        If one is invalid; the message names it, its value and what was expected.

    """
    for name, (expected, is_valid) in _EXPECTED.items():
        if not is_valid(parameters[name]):
            raise ValueError(f'{name} is {parameters[name]!r}; expected {expected}')
