# SPDX-License-Identifier: Apache-2.0

"""Append channels that are unrelated to the task."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmifs_ros.core import Episode

NUM_NOISE = 3
NUM_WALKS = 3


def distractor_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the distractors of a task with these channels."""
    return (
        *(f'noise_{i}' for i in range(1, NUM_NOISE + 1)),
        *(f'walk_{i}' for i in range(1, NUM_WALKS + 1)),
        *(f'other_{name}' for name in names),
    )


def with_distractors(
    episodes: Sequence[Episode], others: Sequence[Episode], seed: int
) -> list[Episode]:
    """Append white noise, random walks and the channels of another robot to each episode.

    Parameters
    ----------
    episodes : sequence of Episode
    others : sequence of Episode
        As many episodes of another robot at the same task: channels with the distribution of the
        relevant ones, but independent of the return. At the end of a shorter episode it stands
        still.
    seed : int
        Seed of the noise and the walks. They are normal with standard deviation 1 per step; a
        walk begins at a normal value with standard deviation 1.

    """
    appended = []
    for i, (episode, other) in enumerate(zip(episodes, others, strict=True)):
        rng = np.random.default_rng([seed, i])
        noise = rng.normal(size=(len(episode), NUM_NOISE))
        walks = np.cumsum(rng.normal(size=(len(episode), NUM_WALKS)), axis=0)
        steps = np.minimum(np.arange(len(episode)), len(other) - 1)
        states = np.hstack([episode.states, noise, walks, other.states[steps]])
        appended.append(Episode(states, episode.rewards))
    return appended
