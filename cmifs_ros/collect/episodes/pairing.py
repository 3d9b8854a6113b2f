# SPDX-License-Identifier: Apache-2.0

"""Pair states with rewards and actions by their stamps, to build episodes.

Stamps are nanoseconds. Everything dropped is counted by cause, so that the node can report it.
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

#: States or rewards that may wait for their partner; as many as the subscriptions queue.
MAX_PENDING = 1000
#: Sets of channels that states may have before the first reward.
MAX_LAYOUTS = 8


class Transition(NamedTuple):
    """A state and its reward."""

    state: array
    sample: RewardSample


class Waiting(dict):
    """Messages that wait for their partner, by stamp, in the order of arrival.

    This is nearly always the order of the stamps, so finding earlier ones needs no search.
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

    A state and a reward belong together if their stamps are equal, or differ by no more than
    `stamp_tolerance`. When a pair is complete, older unpaired messages of either stream are
    dropped and counted. A pair older than the last one means that time was set back: the open
    episode is dropped. A single repeated or late message changes nothing.

    Several nodes may publish parts of a state, each with its own channels. The state that belongs
    to the first reward determines the channels; if several have its stamp, the one with most
    channels. Actions are optional, see `ActionPairing`.

    Parameters
    ----------
    max_episode_steps : int
        See `EpisodeBuilder`.

    Attributes
    ----------
    actions : ActionPairing
        Adds the actions to the pairs.
    builder : EpisodeBuilder
        Builds episodes from them.
    reader : StateReader
        Reads the channels.
    stamp_tolerance : int
        Nanoseconds; more than half the time between two steps would mix them.
    num_transitions : int
        Number of completed pairs.
    dropped_messages : collections.Counter
        Number of dropped messages by cause.
    last_drops : dict of str to str
        By cause, a message about the most recent drop.

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
        """Forget the open episode, all waiting messages and the channels; keep the counts."""
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
        """Number of messages that wait for a partner and of pairs that wait for an action."""
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
        """Return the distance of the nearest state from the newest waiting reward, in nanoseconds.

        None if no reward or no state waits.
        """
        if not self._rewards:
            return None
        newest = next(reversed(self._rewards))
        stamps = chain(self._states, *self._first_states.values())
        return min((abs(stamp - newest) for stamp in stamps), default=None)

    def add_state(self, stamp: int, names: list[str], values: array) -> list[Episode]:
        """Add a state; return the episodes that it completes.

        Parameters
        ----------
        stamp : int
            Nanoseconds.
        names : list of str
        values : array of float
            As many as names. Both are kept without copying and must not change afterwards.

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
        """Add a reward; return the episodes that it completes."""
        stamp = self._partner_of(stamp, self._states)
        if not self._is_new(stamp, sample, self._rewards, 'reward'):
            return []
        self._rewards.add(stamp, sample)
        return self._begin(stamp) if self.channel_names is None else self._pair(stamp)

    def drop_message(self, cause: str, what: str, count: int = 1) -> None:
        """Count one or several unusable messages."""
        self.dropped_messages[cause] += count
        self.last_drops[cause] = what

    def _add_first_state(self, stamp: int, names: list[str], values: array) -> list[Episode]:
        """Keep a state until a reward shows whether its channels are the right ones."""
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
        """Adopt the channels of the state to which a reward belongs, if it has arrived."""
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
        """Return the waiting stamp within the tolerance of this one, or this one."""
        if not self.stamp_tolerance or not waiting or stamp in waiting:
            return stamp
        nearest = min(waiting, key=lambda other: abs(other - stamp))
        return nearest if abs(nearest - stamp) <= self.stamp_tolerance else stamp

    def _is_new(self, stamp: int, content, waiting: Waiting, what: str) -> bool:
        """Return whether a message is new; make room for it."""
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
            # A replayed bag or a reset simulation; a single late message does not count.
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
        'its own, so a simulated clock must tick at least once per step'
    )
