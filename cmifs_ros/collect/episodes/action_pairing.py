# SPDX-License-Identifier: Apache-2.0

"""Give each step its action, by the stamp of its state, before it enters an episode."""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from itertools import takewhile
from math import inf, isfinite
from typing import NamedTuple

from cmifs_ros.core import Episode
from cmifs_ros.core.channel_names import problem_of_names
from cmifs_ros.core.words import counted, listed

from .builder import EpisodeBuilder, RewardSample

#: Steps that may wait for actions, and actions for steps; as many as the subscriptions queue.
_MAX_WAITING = 1000
#: Seconds that a step waits; the middleware resends a lost message after 3 s.
_PATIENCE = 5.0


class _Waiting(NamedTuple):
    """A pending call of the builder; with a stamp if it is a step."""

    hand_on: Callable
    stamp: int | None = None


class ActionPairing:
    """Pass steps to a builder, with their actions if there are any.

    A step waits until its action or a later one has arrived, but not forever. If nobody publishes
    actions, no step waits.

    Parameters
    ----------
    builder : EpisodeBuilder
    drop : callable
        Called with the cause and a message for each unusable action.

    Attributes
    ----------
    are_published : callable
        Returns, when an episode begins, whether to wait for its actions.
    names : tuple of str
        Names of the values of an action, from the first one; empty before it.
    tolerance : int
        Nanoseconds by which the stamps of a state and its action may differ.
    num_without : int
        Steps without an action since the first action.

    """

    def __init__(self, builder: EpisodeBuilder, drop: Callable[[str, str], None]):
        self._builder, self._drop = builder, drop
        self.are_published: Callable[[], bool] = lambda: False
        self.tolerance = 0
        self.num_without = 0
        self.clear()

    def clear(self) -> None:
        """Forget the names and everything that waits; keep the count."""
        self.names: tuple[str, ...] = ()
        self._expects = self._has_given_up = False
        self._actions: dict[int, array] = {}
        self._num_actions, self._newest = 0, -1  # Their number, and the stamp of the last one.
        # State at the last call of `look`, and since when it has been the same.
        self._seen: tuple | None = None
        self._seen_at = inf
        self._waiting: deque[_Waiting] = deque()

    @property
    def num_waiting(self) -> int:
        """Steps that wait for their actions."""
        return len(self._waiting)

    def stop_waiting(self) -> list[Episode]:
        """Pass on everything that waits, because no action will come; return complete episodes."""
        self._expects, self._has_given_up = False, True  # Until there is one.
        return self._release()

    def look(self, now: float) -> list[Episode]:
        """Stop waiting if nothing has moved for some seconds; called about once a second."""
        seen = (self._waiting[0].stamp, self._num_actions) if self._waiting else None
        if seen is None or seen != self._seen:
            self._seen, self._seen_at = seen, now
        return self.stop_waiting() if now - self._seen_at > _PATIENCE else []

    def set_back(self, last: int) -> list[Episode]:
        """Start over, because time was set back from this stamp; return complete episodes."""
        self._actions = {stamp: a for stamp, a in self._actions.items() if stamp < last}
        self._newest = self._newest if self._newest < last else -1
        episodes = self.stop_waiting() if self._waiting else []
        self._expects, self._has_given_up = bool(self.names), False
        self._builder.set_back()
        return episodes

    def add_action(
        self, stamp: int, names: Sequence[str], values: Sequence[float]
    ) -> list[Episode]:
        """Add an action; return the episodes that it completes."""
        problem = self._problem_of(names, values)
        if problem is not None:
            self._drop(*problem)
            return []
        self.names = self.names or tuple(names)
        value_of = dict(zip(names, values, strict=True))
        if len(self._actions) >= _MAX_WAITING:
            del self._actions[next(iter(self._actions))]
        self._actions[stamp] = array('d', [value_of[name] for name in self.names])
        self._num_actions, self._newest = self._num_actions + 1, stamp
        self._expects, self._has_given_up = True, False
        return self._release()

    def add(self, state: Sequence[float], sample: RewardSample, stamp: int) -> list[Episode]:
        """Pass a step on as soon as its action is known; return complete episodes."""
        if not self._waiting and not self._builder.num_open_steps and not self._has_given_up:
            self._expects = self._expects or self.are_published()
        hand_on = partial(self._builder.add, state, sample, stamp)
        self._waiting.append(_Waiting(hand_on, stamp))
        return self.stop_waiting() if len(self._waiting) > _MAX_WAITING else self._release()

    def tell(self, what: Callable[[], None]) -> None:
        """Call a method of the builder after all earlier steps were passed on."""
        if self._waiting:
            self._waiting.append(_Waiting(what))
        else:
            what()

    def _release(self) -> list[Episode]:
        episodes: list[Episode] = []
        while self._waiting:
            waiting = self._waiting[0]
            if waiting.stamp is None:
                waiting.hand_on()
            else:
                at = self._action_at(waiting.stamp)
                has_passed = self._newest > waiting.stamp + self.tolerance
                if at is None and self._expects and not has_passed:
                    break
                self.num_without += at is None and bool(self.names)
                episodes += waiting.hand_on(() if at is None else self._actions.pop(at))
                self._forget_before(waiting.stamp)
            self._waiting.popleft()
        return episodes

    def _forget_before(self, stamp: int) -> None:
        for old in list(takewhile(lambda other: other < stamp, self._actions)):
            del self._actions[old]

    def _action_at(self, stamp: int) -> int | None:
        """Return the stamp of the action of a step."""
        if stamp in self._actions or not self.tolerance:
            return stamp if stamp in self._actions else None
        nearest = min(self._actions, key=lambda other: abs(other - stamp), default=None)
        is_near = nearest is not None and abs(nearest - stamp) <= self.tolerance
        return nearest if is_near else None

    def _problem_of(self, names, values) -> tuple[str, str] | None:
        """Return the cause and a message if an action is unusable."""
        if len(names) != len(values) or not names:
            values_for_names = f'{counted(len(values), "value")} for {counted(len(names), "name")}'
            return 'malformed_action', f'an action has {values_for_names}'
        if self.names and set(names) != set(self.names):
            return (
                'wrong_actions',
                f'an action has the values {listed(names)}; expected {listed(self.names)}',
            )
        problem = problem_of_names(names)
        if problem:
            return 'malformed_action', f'an action has {problem}'
        for name, value in zip(names, values, strict=True):
            if not isfinite(value):
                return 'malformed_action', f'{listed([name])} of an action is {value}'
        return None
