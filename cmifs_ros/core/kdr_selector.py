# SPDX-License-Identifier: Apache-2.0

"""The paper's baseline: selection by kernel dimension reduction (KDR)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral

from .kdr import KDR
from .sensor_selector import SensorSelector
from .sensors import channel_index


class KDRSelector(SensorSelector):
    """Select the sensors that the target channels depend on one step later.

    Hachiya & Sugiyama (2010) compare their method with this one; see `KDR`. It ignores the rewards
    and is told the channels that they depend on directly. Its attributes are those of
    `SensorSelector`.

    Parameters
    ----------
    num_features : int, optional
        Number of sensors to select. None ranks and selects all: each further sensor seems to
        explain the target better, so the criterion has no maximum to stop at.
    target : str, int, or sequence of these
        The channels that the reward depends on directly: names or indices.
    direction, groups
        As in `ConditionalMISelector`.
    random_state : int
        Seed of the subset of samples used for the kernel width, if there are more than 2000.

    """

    def __init__(
        self,
        num_features: int | None = None,
        *,
        target: str | int | Sequence[str | int],
        direction: str = 'forward',
        groups: Mapping[str, Sequence[str | int]] | None = None,
        random_state: int = 0,
    ):
        super().__init__(num_features, direction, groups, random_state)
        self.target = target

    def _rank(self, episodes, names, sensors):
        target = [self.target] if isinstance(self.target, str | int | Integral) else self.target
        if len(target) == 0:
            raise ValueError(f'target is {self.target!r}; expected at least one channel')
        indices = [channel_index(names, channel, 'target') for channel in target]
        criterion = KDR(episodes, indices, random_state=self.random_state)
        return self._rank_by_score(criterion, sensors)
