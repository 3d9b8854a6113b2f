# SPDX-License-Identifier: Apache-2.0

"""Describe problems of the input: causes before their consequences, with a remedy."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cmifs_ros.core.words import counted, listed

from .buffer import EpisodeBuffer
from .pairing import EpisodeAssembler

#: Seconds without a message after which a topic counts as silent.
SILENCE = 5.0
#: Seconds for which a drop is reported.
_MEMORY = 20.0
#: Seconds between two log lines about drops: at first and at most. They double while drops go on.
_LOG_PERIOD, _MAX_LOG_PERIOD = 10.0, 1280.0
#: Causes that follow from other drops; reported only if no other cause is.
_CONSEQUENCES = (
    'lost_end', 'step_gap', 'lost_state', 'joined_midway',
    'state_without_reward', 'reward_without_state', 'too_late',
)  # fmt: skip
#: Categories of problems that are logged as soon as they are detected.
_LOGGED = {'clash', 'parts', 'restart', 'stamps'}


@dataclass(frozen=True)
class Topic:
    """What is known about an input topic.

    Attributes
    ----------
    silence : float
        Seconds since the last message; infinite before the first.
    expected : str
        The message type.
    publishers : sequence of str
        Nodes that publish it with the expected type.
    clashes : mapping of str to sequence of str
        Nodes that publish it with another type, by that type.

    """

    silence: float = math.inf
    expected: str = ''
    publishers: Sequence[str] = ()
    clashes: Mapping[str, Sequence[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Assessment:
    """State of the input: `level` is 'OK', 'WARN' or 'STALE', `kind` categorises the message."""

    level: str
    kind: str
    message: str


class InputWatch:
    """Inspect an assembler about once a second and describe what is wrong.

    Attributes
    ----------
    assessment : Assessment
        The newest one.

    """

    def __init__(self, assembler: EpisodeAssembler, buffer: EpisodeBuffer):
        self._assembler, self._buffer = assembler, buffer
        self.assessment = Assessment('OK', 'none', '')
        #: Time, drops, and number of changes of the channels, oldest first.
        self._counts: deque[tuple[float, Counter, int]] = deque([(-math.inf, Counter(), 0)])
        self._last_transitions = 0
        self._is_unmatched = False
        self._logged_kind = ''
        self._logged_drops: Counter[str] = Counter()
        self._logged_at, self._log_period = -math.inf, _LOG_PERIOD
        self._said_cut = self._said_repeated = self._said_partly_acting = False

    def look(
        self, now: float, topics: Mapping[str, Topic], switched_off: Sequence[str] = ()
    ) -> list[str]:
        """Assess the input at a time in seconds; return new messages worth a warning.

        While a sampler has switched topics off, it is no problem that no states come.
        """
        counts = self._counted()
        self._counts.append((now, counts, self._assembler.reader.num_switches))
        while len(self._counts) > 2 and self._counts[1][0] < now - _MEMORY:
            self._counts.popleft()
        distance = self._assembler.nearest_state()
        has_paired = self._assembler.num_transitions != self._last_transitions
        self._last_transitions = self._assembler.num_transitions
        was_unmatched = self._is_unmatched
        self._is_unmatched = distance is not None and not has_paired
        if not (self._is_unmatched and was_unmatched):
            distance = None
        self.assessment = self._assess(topics, counts, distance)
        if switched_off and self.assessment.kind == 'silent' and topics['state'].publishers:
            what = f'no episodes to learn from while {listed(switched_off)} '
            what += 'is switched off' if len(switched_off) == 1 else 'are switched off'
            self.assessment = Assessment('OK', 'none', what)
        lines = []
        if self.assessment.kind in _LOGGED - {self._logged_kind}:
            lines.append(self.assessment.message)
        self._logged_kind = self.assessment.kind
        return lines + self._new_drops(now, counts) + self._firsts()

    def _counted(self) -> Counter:
        assembler = self._assembler
        counts = assembler.dropped_messages + assembler.builder.dropped
        # If most states have no reward, rewards are rarer by design.
        if counts['state_without_reward'] >= assembler.num_transitions / 2 > 0:
            del counts['state_without_reward']
        return counts

    def _assess(
        self, topics: Mapping[str, Topic], counts: Counter, distance: int | None
    ) -> Assessment:
        problem = (
            _problem_of_state(topics) or self._problem_of_channels() or _problem_of_flow(topics)
        )
        if problem is not None:
            return problem
        if distance is not None:
            return Assessment(
                'WARN',
                'stamps',
                f'no state has the stamp of its reward: the nearest is {_duration(distance)} away; '
                'stamp both alike, or set stamp_tolerance to more than that',
            )
        recent = counts - self._counts[0][1]
        if recent:
            return Assessment('WARN', 'drops', f'dropping: {self._words(recent)}')
        if not len(self._buffer):
            steps = counted(self._assembler.builder.num_open_steps, 'step')
            return Assessment('OK', 'none', f'collecting; the first episode has {steps} so far')
        copies = self._buffer.num_repeated
        what = f'; {counted(copies, "repeated episode")} not kept' if copies else ''
        return Assessment('OK', 'none', f'collecting{what}')

    def _problem_of_channels(self) -> Assessment | None:
        reader = self._assembler.reader
        if reader.num_switches - self._counts[0][2] > 1:
            return Assessment(
                'WARN',
                'parts',
                'states with different channels alternate: those with '
                f'{listed(reader.channel_names)} are used, because they had the stamp of the first '
                f'reward; those that differ by {listed(reader.last_foreign)} are dropped; publish '
                'complete states, or merge the parts with the sampler',
            )
        if reader.foreign:
            return Assessment(
                'WARN',
                'restart',
                f'states now have the channels {listed(reader.foreign)} instead of '
                f'{listed(reader.channel_names)} and are dropped; to start over with them, call '
                '~/clear_episodes or set restart_on_new_channels',
            )
        return None

    def _words(self, drops: Counter) -> str:
        causes = sorted(
            (cause for cause in drops if cause in self._assembler.last_drops),
            key=lambda cause: (
                _CONSEQUENCES.index(cause) if cause in _CONSEQUENCES else -1,
                -drops[cause],
            ),
        )
        return self._assembler.last_drops[causes[0]] if causes else ''

    def _new_drops(self, now: float, counts: Counter) -> list[str]:
        new, quiet = counts - self._logged_drops, now - self._logged_at
        has_new_cause = not new.keys() <= self._logged_drops.keys()
        if not new or quiet < (_LOG_PERIOD if has_new_cause else self._log_period):
            return []
        is_going_on = quiet < 2 * self._log_period and not has_new_cause
        self._log_period = (
            min(2 * self._log_period, _MAX_LOG_PERIOD) if is_going_on else _LOG_PERIOD
        )
        self._logged_at, self._logged_drops = now, counts
        numbers = ', '.join(f'{number} {cause}' for cause, number in new.items())
        lines = [f'dropped {numbers}: {self._words(new)}']
        problem = self._assembler.builder.ends.problem()
        return [*lines, problem] if problem else lines

    def _firsts(self) -> list[str]:
        lines = []
        if self._assembler.builder.num_cut and not self._said_cut:
            self._said_cut = True
            lines.append(
                f'an episode was closed at step {self._assembler.builder.max_episode_steps}, or '
                'because it would exceed the memory: if episodes are longer, raise '
                'max_episode_steps or max_buffer_mb; if they end earlier, set `terminated` or '
                '`truncated` in the reward messages'
            )
        without = self._assembler.builder.num_partly_acting
        if without and not self._said_partly_acting:
            self._said_partly_acting = True
            lines.append(
                'an episode has actions at some of its steps only, so it is kept without actions: '
                'publish an action with the stamp of each state'
            )
        if self._buffer.num_repeated and not self._said_repeated:
            self._said_repeated = True
            lines.append(
                'an exact copy of an earlier episode was dropped: is a bag played in a loop, or a '
                'simulation restarted with the same seed?'
            )
        return lines


def _duration(nanoseconds: int) -> str:
    return f'{nanoseconds} ns' if nanoseconds < 1000 else f'{nanoseconds / 1e6:g} ms'


def _problem_of_state(topics: Mapping[str, Topic]) -> Assessment | None:
    for name, topic in topics.items():
        if topic.clashes:
            kind, nodes = next(iter(topic.clashes.items()))
            what = f'{name} comes from {listed(nodes)} as {kind}; expected {topic.expected}'
            return Assessment('WARN', 'clash', what)
    state = topics['state']
    if state.silence == math.inf:
        return Assessment('WARN', 'silent', f'no state has arrived yet{_without_publisher(state)}')
    if state.silence > SILENCE:
        what = f'no state for {state.silence:.0f} s{_without_publisher(state)}'
        return Assessment('STALE', 'silent', what)
    return None


def _without_publisher(topic: Topic) -> str:
    return '' if topic.publishers else '; nobody publishes it'


def _problem_of_flow(topics: Mapping[str, Topic]) -> Assessment | None:
    reward = topics['reward']
    if reward.silence > SILENCE:
        what = f'states come, but no reward for {SILENCE:.0f} s{_without_publisher(reward)}'
        return Assessment('WARN', 'silent', what)
    action = topics.get('action')
    if action is not None and SILENCE < action.silence < math.inf:
        what = f'states come, but no action for {SILENCE:.0f} s{_without_publisher(action)}'
        return Assessment('WARN', 'silent', what)
    shared = [name for name, topic in topics.items() if len(topic.publishers) > 1]
    if shared:
        return Assessment(
            'WARN',
            'shared',
            f'more than one node publishes {listed(shared)}, so episodes may be mixed: '
            f'{listed(topics[shared[0]].publishers)}',
        )
    return None
