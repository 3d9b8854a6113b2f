# SPDX-License-Identifier: Apache-2.0

"""Encoders of other installed packages, by the names that these declare as entry points.

Nothing is imported but what an installed package offers for this purpose, and only when a robot
file names it.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points

from cmifs_ros.collect.sensor_groups import groups_by_name

from .encoder import Encoder

#: The group of entry points; each refers to a subclass of `Encoder`, or a function that returns
#: one, called without arguments.
GROUP = 'cmifs_ros.encoders'


def installed_names() -> list[str]:
    """Return the names of all installed encoders."""
    return sorted({entry.name for entry in entry_points(group=GROUP)})


def installed(name: str) -> Encoder:
    """Return an installed encoder by one of `installed_names`.

    Raises
    ------
    ValueError
        If several packages have one of this name, it cannot be loaded, or it is not an encoder.

    """
    entry, *others = dict.fromkeys(entry_points(group=GROUP, name=name))
    what = _described(entry)
    if others:
        raise ValueError(f'both {what} and {_described(others[0])}; uninstall one of them')
    try:
        encoder = entry.load()()
    except Exception as error:  # An import may raise anything.
        said = ' '.join(str(error).split())[:200]
        raise ValueError(f'{what}, which fails ({type(error).__name__}: {said})') from error
    if not isinstance(encoder, Encoder):
        raise ValueError(f'{what}, which gives a {type(encoder).__name__}; expected an Encoder')
    channels = [f'x{suffix}' for suffix in encoder.suffixes]
    if channels != ['x'] and list(groups_by_name(channels).get('x', ())) != channels:
        raise ValueError(
            f'{what}, which has the suffixes {list(encoder.suffixes)[:10]}; expected two or more '
            "such as '[0]', '[1]' or '.left', '.right', or '' alone"
        )
    return encoder


def _described(entry: EntryPoint) -> str:
    return f'{entry.value} of {entry.dist.name}' if entry.dist else entry.value
