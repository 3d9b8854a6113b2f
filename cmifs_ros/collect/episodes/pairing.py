# SPDX-License-Identifier: Apache-2.0

"""Pair states with rewards and actions by their stamps, for episodes to be built of.

Nothing here knows ROS: stamps are nanoseconds, and what is dropped is counted by cause, so
that the node can report it and nothing disappears silently.
"""

from __future__ import annotations

from array import array
from collections import Counter
from functools import partial
from itertools import chain, takewhile
from typing import NamedTuple

from cmifs_ros.core import Episode
from cmifs_ros.core.words import listed

from .action_pairing import ActionPairing
from .builder import EpisodeBuilder, RewardSample
from .state_reader import StateReader, problem_of_state

#: States or rewards that wait for their partner; as many as the subscriptions queue.
MAX_PENDING = 1000
#: Sets of channels with which states may come before the first reward.
MAX_LAYOUTS = 8


class Transition(NamedTuple):
    """A state and its reward."""

    state: array
    sample: RewardSample


class Waiting(dict):
    """What waits for its partner, by stamp, in the order of arrival.

    That is nearly always the order of the stamps, so that those before another need no search.
    """

    _is_in_order = True

    def add(self, stamp: int, content) -> None:
        """Add a message."""
        self._is_in_order = not self or (self._is_in_order and stamp > next(reversed(self)))
        self[stamp] = content

    def older_than(self, stamp: int) -> list[int]:
        """Return the stamps before another."""
        if not self:
            return []
        if self._is_in_order:
            return list(takewhile(lambda waiting: waiting < stamp, self))
        return [waiting for waiting in self if waiting < stamp]


class EpisodeAssembler:
    """Build episodes from states, rewards and actions that arrive as separate streams.

    A state and a reward belong together when their stamps are equal, or no further apart than
    `stamp_tolerance`. Once a pair is complete, older unpaired messages of either stream are lost
    and counted. A pair that is older than the last one means that time was set back: the open
    episode is dropped. A single message sent again or late changes nothing.

    Several nodes may publish parts of a state, each with channels of its own. The channels are
    those of the state to which the first reward belongs, whichever part came first; of several
    with its stamp, those that are most. Actions need not be there, see `ActionPairing`.

    Parameters
    ----------
    max_episode_steps : int
        See `EpisodeBuilder`.

    Attributes
    ----------
    actions : ActionPairing
        Gives the pairs their actions.
    builder : EpisodeBuilder
        Makes episodes of them.
    reader : StateReader
        Knows the channels.
    stamp_tolerance : int
        Nanoseconds; more than half the time between two steps would mix them.
    num_transitions : int
        Pairs completed so far.
    dropped_messages : collections.Counter
        How many were dropped, by cause.
    last_drops : dict of str to str
        By cause, the most recent dropped message or episode in words.

    """

    def __init__(self, max_episode_steps: int):
        self.builder = EpisodeBuilder(max_episode_steps)
        self.stamp_tolerance = 0
        self.num_transitions = 0
        self.dropped_messages: Counter[str] = Counter()
        self.last_drops = self.builder.last_drops
        self.reader = StateReader(self.drop_message)
        self.actions = ActionPairing(self.builder, self.drop_message)
        self.clear()

    def clear(self) -> None:
        """Forget the open episode, all that waits, and the channels; keep the counts."""
        self.actions.clear()
        self.builder.clear()
        self.reader.clear()
        self._states = Waiting()
        self._first_states: dict[tuple[str, ...], Waiting] = {}  # while no channels are known
        self._rewards = Waiting()
        self._recent: dict[int, Transition] = {}
        self._last_paired: int | None = None

    @property
    def num_pending(self) -> int:
        """States and rewards that wait for their partner, and pairs for their action."""
        waiting = (self._states, self._rewards, *self._first_states.values())
        return sum(map(len, waiting)) + self.actions.num_waiting

    @property
    def channel_names(self) -> tuple[str, ...] | None:
        """The channels of the first state that had a reward."""
        return self.reader.channel_names

    @channel_names.setter
    def channel_names(self, names: tuple[str, ...] | None) -> None:
        self.reader.channel_names = names

    def nearest_state(self) -> int | None:
        """Return how far the nearest state is from the newest reward that waits, in nanoseconds.

        None if there is no such reward, or no state waits.
        """
        if not self._rewards:
            return None
        newest = next(reversed(self._rewards))
        stamps = chain(self._states, *self._first_states.values())
        return min((abs(stamp - newest) for stamp in stamps), default=None)

    def add_state(self, stamp: int, names: list[str], values: array) -> list[Episode]:
        """Take a state; return the episodes that it completes.

        Parameters
        ----------
        stamp : int
            Nanoseconds.
        names : list of str
        values : array of float
            As many as names. Both are kept, not copied: they may not change afterwards.

        """
        if self.channel_names is None:
            return self._add_first_state(stamp, names, values)
        state = self.reader.state_of(names, values)
        stamp = self._partner_of(stamp, self._rewards)
        if state is None or not self._is_new(stamp, state, self._states, 'state'):
            return []
        self._states.add(stamp, state)
        return self._pair(stamp)

    def add_reward(self, stamp: int, sample: RewardSample) -> list[Episode]:
        """Take a reward; return the episodes that it completes."""
        stamp = self._partner_of(stamp, self._states)
        if not self._is_new(stamp, sample, self._rewards, 'reward'):
            return []
        self._rewards.add(stamp, sample)
        return self._begin(stamp) if self.channel_names is None else self._pair(stamp)

    def drop_message(self, cause: str, what: str, count: int = 1) -> None:
        """Count a message, or several, that cannot be used."""
        self.dropped_messages[cause] += count
        self.last_drops[cause] = what

    def _add_first_state(self, stamp: int, names: list[str], values: array) -> list[Episode]:
        """Keep a state as long as no reward has told whether its channels are those that count."""
        problem = problem_of_state(names, values)
        if problem is not None:
            self.drop_message(*problem)
            return []
        value_of = dict(zip(names, values, strict=True))
        layout = next((known for known in self._first_states if set(known) == set(names)), None)
        if layout is None:
            if len(self._first_states) >= MAX_LAYOUTS:
                self._drop_first_states(next(iter(self._first_states)), 'state_without_reward')
            layout = tuple(names)
            self._first_states[layout] = Waiting()
        waiting = self._first_states[layout]
        state = array('d', [value_of[name] for name in layout])
        if not self._is_new(stamp, state, waiting, 'state'):
            return []
        waiting.add(stamp, state)
        partner = self._partner_of(stamp, self._rewards)
        return self._begin(partner) if partner in self._rewards else []

    def _begin(self, stamp: int) -> list[Episode]:
        """Take the channels of the state to which a reward belongs, if it is there."""
        found = []
        for layout, waiting in self._first_states.items():
            partner = self._partner_of(stamp, waiting)
            if partner in waiting:
                found.append((-abs(partner - stamp), len(layout), layout))
        if not found:
            return []
        *_, layout = max(found)
        self.channel_names = layout
        states = self._first_states.pop(layout)
        for other in list(self._first_states):
            self._drop_first_states(other, 'wrong_channels')
        completed = []
        for waiting, values in states.items():
            completed += self.add_state(waiting, list(layout), values)
        return completed

    def _drop_first_states(self, layout: tuple[str, ...], cause: str) -> None:
        count = len(self._first_states.pop(layout))
        self.drop_message(cause, f'no state of {listed(layout)} had the stamp of a reward', count)

    def _partner_of(self, stamp: int, waiting: Waiting) -> int:
        """Return the stamp within the tolerance that waits for this one, or else this one."""
        if not self.stamp_tolerance or not waiting or stamp in waiting:
            return stamp
        nearest = min(waiting, key=lambda other: abs(other - stamp))
        return nearest if abs(nearest - stamp) <= self.stamp_tolerance else stamp

    def _is_new(self, stamp: int, content, waiting: Waiting, what: str) -> bool:
        """Tell whether a message is none of those already taken, and make room for it."""
        paired = self._recent.get(stamp)
        if stamp in waiting and content != waiting[stamp]:
            self.drop_message('equal_stamps', _equal_stamps(what, stamp))
            return False
        if stamp in waiting or (paired is not None and content in paired):
            self.drop_message('duplicate_stamp', f'a second {what} is stamped {stamp} ns')
            return False
        if len(waiting) >= MAX_PENDING:
            oldest = next(iter(waiting))
            if what == 'state':
                self._discard_state(oldest, 'state_without_reward', waiting)
            else:
                self._discard_reward(oldest, 'reward_without_state')
        return True

    def _pair(self, stamp: int) -> list[Episode]:
        if stamp not in self._states or stamp not in self._rewards:
            return []
        transition = Transition(self._states.pop(stamp), self._rewards.pop(stamp))
        last, completed = self._last_paired, []
        if stamp == last:
            what = _equal_stamps('state', stamp)
            self.actions.tell(partial(self.builder.break_off, 'equal_stamps', what))
        elif last is not None and stamp < last:
            # A replayed bag or a reset simulation. A single message that is late is no reason.
            completed = self.actions.set_back(last)
            for old in [s for s in self._states if s > last]:
                self._discard_state(old, 'state_without_reward')
            for old in [s for s in self._rewards if s > last]:
                self._discard_reward(old, 'reward_without_state')
            self._recent.clear()
            last = None
        for old in self._states.older_than(stamp):
            is_late = last is not None and old <= last
            self._discard_state(old, 'too_late' if is_late else 'state_without_reward')
        for old in self._rewards.older_than(stamp):
            if last is not None and old <= last:
                self._discard_reward(old, 'too_late')
                continue
            sample = self._discard_reward(old, 'reward_without_state')
            self.actions.tell(partial(self.builder.skip, sample))
        self._last_paired = stamp
        self._recent[stamp] = transition
        if len(self._recent) > MAX_PENDING:
            del self._recent[next(iter(self._recent))]
        self.num_transitions += 1
        return completed + self.actions.add(transition.state, transition.sample, stamp)

    def _discard_state(self, stamp: int, cause: str, waiting: Waiting | None = None) -> None:
        del (self._states if waiting is None else waiting)[stamp]
        self.drop_message(cause, f'the state at {stamp} ns has no reward or came too late')

    def _discard_reward(self, stamp: int, cause: str) -> RewardSample:
        self.drop_message(cause, f'the reward at {stamp} ns has no usable state or came too late')
        return self._rewards.pop(stamp)


def _equal_stamps(what: str, stamp: int) -> str:
    return (
        f'two different messages of {what} have the same stamp, {stamp} ns: each step needs one of '
        'its own, so a simulated clock has to tick at least once a step'
    )
