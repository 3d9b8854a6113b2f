# SPDX-License-Identifier: Apache-2.0

"""The frames of a camera at which it matters most to a selection."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from cmifs_ros.core.contribution import contribution
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.targets import Contribution
from cmifs_ros.core.thinning import ThinnedEpisodes

from .pooling import Pool
from .recorded_episodes import RecordedEpisodes

#: Frames that raise the prediction, and as many that lower it.
_NUM_EACH = 4


class ExampleFrame(NamedTuple):
    """A frame of a camera.

    Attributes
    ----------
    picture : numpy.ndarray, shape (height, width)
        Grey values of type uint8.
    variable : str
        What the camera helps to predict; see `Contribution`.
    value : float
        What it adds to the prediction, in standard deviations of the variable.
    episode, step : int

    """

    picture: np.ndarray
    variable: str
    value: float
    episode: int
    step: int


def example_frames(
    selection: Selection,
    episodes: ThinnedEpisodes,
    pool: Pool,
    recordings: Sequence[RecordedEpisodes],
    ordered: bool,
) -> dict[str, list[ExampleFrame]]:
    """Return frames of each selected camera, by sensor: those that add most to the prediction.

    They are those that raise it most, then those that lower it most, each time of different
    episodes. The recordings are read again, as no picture is kept.

    Parameters
    ----------
    selection : Selection
    episodes : ThinnedEpisodes
        Those of the selection.
    pool : Pool
    recordings : sequence of RecordedEpisodes
        The recordings of the pool.
    ordered : bool
        As in the selection.

    Raises
    ------
    RecordingError
        If a recording can no longer be read.

    """
    cameras = {name for one in recordings for name in one.cameras}
    found = {}
    for name in sorted(cameras.intersection(selection.selected)):
        added = contribution(
            selection, name, episodes, pool.channel_names,
            action_names=pool.action_names, ordered=ordered,
        )  # fmt: skip
        order = np.argsort(added.values, kind='stable')
        raising = [i for i in order[::-1] if added.values[i] > 0]
        lowering = [i for i in order if added.values[i] < 0]
        rows = [row for side in (raising, lowering) for row in _of_different(added, side)]
        found[name] = _frames(name, added, rows, pool.origins, recordings)
    return found


def _of_different(added: Contribution, rows: Iterable[int]) -> list[int]:
    """Return the first rows that belong to different episodes."""
    by_episode: dict[int, int] = {}
    for row in rows:
        by_episode.setdefault(int(added.episodes[row]), row)
        if len(by_episode) == _NUM_EACH:
            break
    return list(by_episode.values())


def _frames(
    name: str,
    added: Contribution,
    rows: Sequence[int],
    origins: Sequence[tuple[int, int]],
    recordings: Sequence[RecordedEpisodes],
) -> list[ExampleFrame]:
    pictures: dict[int, np.ndarray | None] = {}
    for number in {origins[added.episodes[row]][0] for row in rows}:
        own = [row for row in rows if origins[added.episodes[row]][0] == number]
        steps = [(origins[added.episodes[row]][1], int(added.steps[row])) for row in own]
        pictures.update(zip(own, recordings[number].cameras[name](steps), strict=True))
    return [
        ExampleFrame(
            picture, added.variable, float(added.values[row]),
            int(added.episodes[row]), int(added.steps[row]),
        )
        for row in rows
        if (picture := pictures[row]) is not None
    ]  # fmt: skip
