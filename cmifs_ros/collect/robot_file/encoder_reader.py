# SPDX-License-Identifier: Apache-2.0

"""Read the encoder of a source from YAML: `as`, and the options of each encoder."""

from __future__ import annotations

import math
from itertools import pairwise

import yaml

from cmifs_ros.collect.encoders import Cloud, Encoder, Image, Scan, Yaw

from .yaml_nodes import Nodes, shown

#: What `as` may be, with the options of each.
_ENCODERS: dict[str, tuple[type[Encoder], tuple[str, ...]]] = {
    'yaw': (Yaw, ()),
    'image': (Image, ()),
    'scan': (Scan, ('sectors',)),
    'cloud': (Cloud, ('sectors', 'max_range', 'heights')),
}
OPTIONS = ('sectors', 'max_range', 'heights')
_MAX_SECTORS, _MAX_HEIGHTS = 360, 10


class EncoderReader(Nodes):
    """Read encoders."""

    def encoder(self, parts: dict, name: str) -> Encoder | None:
        """Return the encoder of a source with these keys; None without one, or with a mistake."""
        kind: type[Encoder] | None = None
        allowed: tuple[str, ...] = ()
        if 'as' in parts:
            kind, allowed = _ENCODERS[self.choice(parts['as'], f'{name}.as', tuple(_ENCODERS))]
        for key in OPTIONS:
            if key in parts and key not in allowed:
                users = ' or '.join(f'as: {k}' for k, (_, keys) in _ENCODERS.items() if key in keys)
                self.note(parts[key], f'{name} has {key}; expected it with {users} only')
        if kind is None:
            return None
        options: dict = {}
        if 'sectors' in allowed and 'sectors' in parts:
            number = self.number(parts['sectors'], f'{name}.sectors', 1, _MAX_SECTORS, 1)
            options['num_sectors'] = int(number)
        if 'max_range' in allowed and 'max_range' in parts:
            what = f'{name}.max_range'
            options['max_range'] = self.number(parts['max_range'], what, 0.001, 10**6, 1.0)
        if 'heights' in allowed and 'heights' in parts:
            options['heights'] = self._heights(parts['heights'], f'{name}.heights')
        return kind(**options)

    def _heights(self, node, what: str) -> tuple[float, ...]:
        items = node.value if isinstance(node, yaml.SequenceNode) else []
        if not 2 <= len(items) <= _MAX_HEIGHTS:
            said = f'{len(items)} numbers' if items else shown(node)
            self.note(
                node, f'{what} is {said}; expected the limits of bands, 2 to {_MAX_HEIGHTS} '
                'ascending numbers such as [0.1, 0.5, 2.0]',
            )  # fmt: skip
            return ()
        heights = [self.number(item, what, -math.inf, math.inf, math.nan) for item in items]
        if any(low >= high for low, high in pairwise(heights)):
            self.note(node, f'{what} is {heights}; expected ascending numbers')
        return tuple(heights)
