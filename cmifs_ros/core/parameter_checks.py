# SPDX-License-Identifier: Apache-2.0

"""Checks of the parameters of `ConditionalMISelector`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from numbers import Integral, Real
from typing import Any

from .targets import TARGETS


def _is_whole(value: Any, least: int) -> bool:
    return isinstance(value, Integral) and int(value) >= least


def _is_share(value: Any) -> bool:
    return isinstance(value, Real) and 0 < float(value) < 1


#: What is expected of each parameter, and whether a value is that. (The range of `gamma` is checked
#: with the returns, that of `num_centers` with the kernels.)
_EXPECTED: Mapping[str, tuple[str, Callable[[Any], bool]]] = {
    'target': (f'one of {", ".join(TARGETS)}', TARGETS.__contains__),
    'gamma': ('a number', lambda value: isinstance(value, Real)),
    'max_time_bins': (
        "a whole number, at least 1, None for no bins, or 'auto'",
        lambda value: value in (None, 'auto') or _is_whole(value, 1),
    ),
    'tuning_window': ('a whole number, at least 0', lambda value: _is_whole(value, 0)),
    'num_centers': (
        'a whole number or None',
        lambda value: value is None or isinstance(value, Integral),
    ),
    'significance': ('0 < significance < 1', _is_share),
    'margin': ('0 < margin < 1', _is_share),
    'random_state': ('a whole number, at least 0', lambda value: _is_whole(value, 0)),
    'n_jobs': ('a whole number, at least 1', lambda value: _is_whole(value, 1)),
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
