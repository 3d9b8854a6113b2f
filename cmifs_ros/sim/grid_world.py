# SPDX-License-Identifier: Apache-2.0

"""The grid-world robot of Hachiya & Sugiyama (2010), Section 4.1.

The world is a 10 x 10 grid with a wall in column 5 that has a gap at rows 5 and 6. The robot is
rewarded for being in column 10. Of its 14 channels only the position, the battery and, with gravel,
the gravel sensor are relevant; the others are noise. Positions are 1 to 10, as in the paper. Row 1
is at the top, and `down` increases the row. The interface is Gymnasium's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

SIZE = 10
NUM_CHANNELS = 14
MAX_EPISODE_STEPS = 20
FULL_BATTERY = 20
MOVE_COST = 1
TARGET_COLUMN = 10
TARGET_REWARD = 2.0
GRAVEL_PROBABILITY = 0.1
GRAVEL_STEPS = 4
GRAVEL_COST = 3
SCENARIOS = ('without_gravel', 'with_gravel')

UP, DOWN, LEFT, RIGHT = range(4)
MOVES = {UP: (0, -1), DOWN: (0, 1), LEFT: (-1, 0), RIGHT: (1, 0)}  # (column, row)

# Indexed [column - 1, row - 1].
WALLS = np.zeros((SIZE, SIZE), dtype=bool)
WALLS[4, [0, 1, 2, 3, 6, 7, 8, 9]] = True


class Step(NamedTuple):
    """The result of `GridWorld.step`: the five values of Gymnasium's interface."""

    observation: np.ndarray
    reward: float
    terminated: bool
    truncated: bool
    info: dict


def channel_names(scenario: str) -> tuple[str, ...]:
    """Return the names of the 14 channels, s(1) to s(14) of the paper."""
    fourth = 'gravel' if scenario == 'with_gravel' else 'noise_4'
    return ('x', 'y', 'battery', fourth, *(f'noise_{i}' for i in range(5, NUM_CHANNELS + 1)))


class GridWorld:
    """The world, in episodes of 20 steps.

    Parameters
    ----------
    scenario : {'without_gravel', 'with_gravel'}
        Whether each episode has gravel, which the fourth channel senses.
    seed : int, optional
        Seed of all randomness; the same seed gives the same episodes bit for bit.

    Raises
    ------
    ValueError
        If the scenario is unknown.

    """

    def __init__(self, scenario: str = 'without_gravel', seed: int | None = None):
        if scenario not in SCENARIOS:
            raise ValueError(f'scenario is {scenario!r}; expected one of {", ".join(SCENARIOS)}')
        self.scenario = scenario
        self._rng = np.random.default_rng(seed)
        self._num_steps: int | None = None

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of the 14 channels."""
        return channel_names(self.scenario)

    def reset(self, seed: int | None = None) -> tuple[np.ndarray, dict]:
        """Start an episode in column 1 at a random row, with a full battery.

        Returns
        -------
        observation : numpy.ndarray, shape (14,)
        info : dict
            Empty; part of Gymnasium's interface.

        """
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        self.column, self.row = 1, int(self._rng.integers(1, SIZE + 1))
        self.battery = FULL_BATTERY
        #: Where gravel lies in this episode, indexed [column - 1, row - 1].
        self.gravel = np.zeros((SIZE, SIZE), dtype=bool)
        if self.scenario == 'with_gravel':
            self._lay_gravel()
        self._gravel_steps_left = 0
        self._num_steps = 0
        return self._observe(), {}

    def step(self, action: int) -> Step:
        """Try one move: UP, DOWN, LEFT or RIGHT (0 to 3).

        Raises
        ------
        ValueError
            If the action is unknown.
        RuntimeError
            If no episode is running.

        """
        if action not in MOVES:
            raise ValueError(f'action is {action}; expected 0 (up), 1 (down), 2 (left), 3 (right)')
        if self._num_steps is None or self._num_steps >= MAX_EPISODE_STEPS:
            raise RuntimeError('no episode is running; call reset() first')
        in_gravel = self._gravel_steps_left > 0
        self._gravel_steps_left = max(0, self._gravel_steps_left - 1)

        moved = self.battery > 0 and self._move(*MOVES[action])
        if in_gravel:
            self.battery = max(0, self.battery - GRAVEL_COST)
        elif moved:
            self.battery -= MOVE_COST
        if moved and not in_gravel and self.gravel[self.column - 1, self.row - 1]:
            self._gravel_steps_left = GRAVEL_STEPS

        self._num_steps += 1
        reward = TARGET_REWARD if self.column == TARGET_COLUMN else 0.0
        truncated = self._num_steps == MAX_EPISODE_STEPS
        return Step(self._observe(), reward, False, truncated, {})

    def _lay_gravel(self) -> None:
        # Columns 2 to 9: never where the robot starts, never on the target.
        self.gravel[1:9] = self._rng.random((8, SIZE)) < GRAVEL_PROBABILITY
        self.gravel &= ~WALLS

    def _move(self, right: int, down: int) -> bool:
        column, row = self.column + right, self.row + down
        if not (1 <= column <= SIZE and 1 <= row <= SIZE) or WALLS[column - 1, row - 1]:
            return False
        self.column, self.row = column, row
        return True

    def _observe(self) -> np.ndarray:
        # Channel i (from 1) is noise with mean i - 3 unless it is a sensor.
        noise = self._rng.normal(np.arange(4, NUM_CHANNELS + 1) - 3.0, 1.0)
        state = np.concatenate(([self.column, self.row, self.battery], np.floor(noise)))
        if self.scenario == 'with_gravel':
            state[3] = self._sense_gravel()
        return state

    def _sense_gravel(self) -> int:
        if self._gravel_steps_left > 0:
            return 3
        # self.column is the index of the column to the right, counted from 0.
        ahead = self.column < SIZE and self.gravel[self.column, self.row - 1]
        return 2 if ahead else 1
