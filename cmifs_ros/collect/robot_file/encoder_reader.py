# SPDX-License-Identifier: Apache-2.0

"""Read the encoder of a source from YAML: `as`, and the options of each encoder."""

from __future__ import annotations

import math
from itertools import pairwise

import yaml

from cmifs_ros.collect.encoders import (
    Cloud,
    Encoder,
    Image,
    Scan,
    Yaw,
    installed,
    installed_names,
)

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
        chosen = parts['as'].value if isinstance(parts.get('as'), yaml.ScalarNode) else ''
        kind, allowed = _ENCODERS.get(chosen, (None, ()))
        for key in OPTIONS:
            if key in parts and key not in allowed:
                users = ' or '.join(f'as: {k}' for k, (_, keys) in _ENCODERS.items() if key in keys)
                self.note(parts[key], f'{name} has {key}; expected it with {users} only')
        if kind is None:
            return self._installed(parts['as'], f'{name}.as') if 'as' in parts else None
        options: dict = {}
        if 'sectors' in allowed and 'sectors' in parts:
            options['num_sectors'] = self.number(
                parts['sectors'], f'{name}.sectors', 1, _MAX_SECTORS, 1, is_whole=True
            )
        if 'max_range' in allowed and 'max_range' in parts:
            what = f'{name}.max_range'
            options['max_range'] = self.number(parts['max_range'], what, 0.001, 10**6, 1.0)
        if 'heights' in allowed and 'heights' in parts:
            options['heights'] = self._heights(parts['heights'], f'{name}.heights')
        return kind(**options)

    def _installed(self, node, what: str) -> Encoder | None:
        """Return an encoder of another package, which cannot replace one of our own."""
        names = installed_names()
        if self.choice(node, what, (*_ENCODERS, *names)) not in names:
            return None
        try:
            return installed(node.value)
        except ValueError as error:
            self.note(node, f'{what} is {shown(node)}: {error}')
            return None

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
