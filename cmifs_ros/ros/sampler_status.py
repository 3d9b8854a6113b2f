# SPDX-License-Identifier: Apache-2.0

"""The sampler's diagnostics: the condition of each topic, and what steps lack."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Mapping
from statistics import median_low

from diagnostic_msgs.msg import DiagnosticStatus

from cmifs_ros.collect.sampling.sampler import Sampler
from cmifs_ros.core.words import counted, listed

from . import diagnostics

#: Seconds that rates and problems refer to, at one report a second.
_WINDOW = 10
#: Seconds after which a topic is reported as silent, unless its `max_age` is longer.
_SILENCE = 5.0
#: Seconds after the first step in which missing topics are not reported: discovery takes time.
_GRACE = 3.0
#: Causes reported, the most frequent ones.
_MAX_CAUSES = 8
#: Seconds from its stamp in which a message is expected, and those beyond which the stamps are of
#: another clock altogether.
_LATE, _OTHER_CLOCK = 1.0, 60.0
#: Log lines for causes that are found at once.
_MAX_LINES = 3


class SamplerStatus:
    """Compose the statuses of a sampler, once a second.

    Parameters
    ----------
    name : str
        The node's name, before the colon of each status.
    sampler : Sampler
    max_ages : mapping of str to float
        By topic, the seconds for which its newest message is valid.

    """

    def __init__(self, name: str, sampler: Sampler, max_ages: Mapping[str, float]):
        self._name, self._sampler, self._max_ages = name, sampler, max_ages
        self._heard_at: dict[str, float] = {}
        self._off_at: dict[str, float] = {}  # When a topic was last seen to be switched off.
        # By topic, the least and the greatest age of messages since the last report.
        self._ages: dict[str, tuple[float, float]] = {}
        self._lag = 0.0  # Of most topics at the last report.
        self._told_lag = False
        self._past: deque[dict] = deque(maxlen=_WINDOW)
        self._stepping_at: float | None = None
        self._told: Counter = Counter()  # What steps lacked at the last call.
        self._told_losses = False

    def heard(self, topic: str, age: float) -> None:
        """Note that a message is taken, so many seconds after its stamp; inf if it has none."""
        self._heard_at[topic] = time.monotonic()
        if abs(age) < _OTHER_CLOCK:
            least, greatest = self._ages.get(topic, (age, age))
            self._ages[topic] = min(least, age), max(greatest, age)

    def silence(self) -> float:
        """Return the seconds since the newest message of any topic; inf if there was none."""
        return time.monotonic() - max(self._heard_at.values(), default=-math.inf)

    def news(self) -> list[str]:
        """Return log lines, each only once: what steps lack, a lag, losses that depend on the end.

        If much is lacking at once, which mostly has one reason, such as a robot that stands still,
        there is one line.
        """
        now, missing = time.monotonic(), Counter(self._sampler.missing.counts)
        if self._stepping_at is None and self._sampler.num_moments:
            self._stepping_at = now
        if self._stepping_at is None or now < self._stepping_at + _GRACE:
            self._told = missing
            return []
        fresh = {key: n for key, n in missing.items() if n > self._told.get(key, 0)}
        self._told |= dict.fromkeys(fresh, math.inf)
        causes = list(self._sampler.missing.in_words(fresh))
        if len(causes) > _MAX_LINES:
            more = len(causes) - _MAX_LINES
            causes = [f'{"; ".join(causes[:_MAX_LINES])}; and {more} more, see /diagnostics']
        lines = [f'steps lack {what}; this breaks episodes' for what in causes]
        if self._lag > _LATE and not self._told_lag:
            self._told_lag = True
            lines.append(self._lag_in_words())
        losses = self._sampler.ends.problem()
        if losses and not self._told_losses:
            self._told_losses = True
            lines.append(losses)
        return lines

    def statuses(self, problems: Mapping[str, str]) -> list[DiagnosticStatus]:
        """Return a status of the steps and one for each topic.

        Parameters
        ----------
        problems : mapping of str to str
            Problems by topic that the node knows, such as that nobody publishes it.

        """
        sampler = self._sampler
        now = {
            'time': time.monotonic(),
            'moments': sampler.num_moments,
            'steps': sampler.num_steps,
            'between': sampler.num_between,
            'missing': Counter(sampler.missing.counts),
            **{key: Counter(getattr(sampler, key)) for key in ('received', 'late', 'wrong')},
        }
        past = self._past[0] if self._past else now
        self._past.append(now)
        seconds = now['time'] - past['time']
        # The median: the clock of a single topic may be wrong.
        self._lag = max(0.0, median_low([least for least, _ in self._ages.values()] or [0.0]))
        topics = [
            self._topic(topic, now, past, seconds, problems.get(topic, ''))
            for topic in self._max_ages
        ]
        self._ages.clear()
        return [self._steps(now, past, seconds, problems), *topics]

    def _steps(self, now: dict, past: dict, seconds: float, problems) -> DiagnosticStatus:
        sampler = self._sampler
        moments, lacking = now['moments'] - past['moments'], now['missing'] - past['missing']
        level, message = diagnostics.OK, 'steps are made'
        if lacking:
            causes = sampler.missing.in_words(lacking).most_common(_MAX_CAUSES)
            shown = '; '.join(f'{count} lack {what}' for what, count in causes)
            level = diagnostics.WARN
            message = f'of the last {counted(moments, "step")}, {shown}; this breaks episodes'
        elif not moments and not problems:
            level, message = diagnostics.STALE, 'no step is due'
        elif sampler.away:
            message = f'no steps to learn from without {listed(sorted(sampler.away))}'
        elif problems:
            level, message = diagnostics.WARN, f'topics with problems: {listed(sorted(problems))}'
        elif now['between'] - past['between'] == moments:
            message = 'between episodes: the end condition of the last one still holds'
        for problem in filter(None, (self._lag_in_words(), sampler.ends.problem())):
            is_well = level == diagnostics.OK
            level, message = (
                (diagnostics.WARN, problem) if is_well else (level, f'{problem}; {message}')
            )
        values = {
            'steps': now['steps'],
            'moments': now['moments'],
            'between episodes': now['between'],
            'steps per s': _rate(now['steps'] - past['steps'], seconds),
            **{
                f'missing: {what}': f'{count} of {now["moments"]}'
                for what, count in sampler.missing.in_words(now['missing']).most_common(_MAX_CAUSES)
            },
            **{f'episodes ended: {kind}': count for kind, count in sampler.ends.ended.items()},
            **{f'episodes lost: {kind}': sampler.ends.num_lost(kind) for kind in sampler.ends.lost},
        }
        return diagnostics.status(f'{self._name}: steps', level, message, values)

    def _lag_in_words(self) -> str:
        if self._lag <= _LATE:
            return ''
        return (
            f'messages of most topics are taken {self._lag:.1f} s after their stamps: give this '
            "node more processor time, or set this machine's clock"
        )

    def _topic(self, topic: str, now: dict, past: dict, seconds: float, problem: str):
        if is_off := topic in self._sampler.saving.off:
            self._off_at[topic] = now['time']
        heard_at = self._heard_at.get(topic, -math.inf)
        age = now['time'] - max(heard_at, self._off_at.get(topic, -math.inf))
        is_silent = age > max(_SILENCE, self._max_ages[topic])
        fresh = {key: now[key][topic] - past[key][topic] for key in ('late', 'wrong')}
        least, greatest = self._ages.get(topic, (self._lag, self._lag))
        level, message = diagnostics.OK, 'received'
        if least - self._lag > _LATE:
            message = f'received {least:.1f} s after its stamps'
        if is_off:
            message = 'switched off'
        elif problem:
            level, message = diagnostics.STALE if is_silent else diagnostics.WARN, problem
        elif is_silent:
            level, message = (
                diagnostics.STALE,
                'no message arrived' if age == math.inf else 'silent',
            )
        elif fresh['wrong'] > 0:
            level, message = diagnostics.WARN, f'unusable: {self._sampler.last_wrong[topic]}'
        elif fresh['late']:
            level, message = diagnostics.WARN, 'arrives later than steps can wait'
        elif (ahead := self._lag - greatest) > _LATE:
            level = diagnostics.WARN
            message = f'its stamps are {ahead:.1f} s ahead: set the clock of whoever stamps it'
        values = {
            'messages': now['received'][topic],
            'rate in Hz': _rate(now['received'][topic] - past['received'][topic], seconds),
            'age in s': f'{age:.1f}',
            'waiting time in s': f'{self._sampler.wait_for(topic):.2f}',
            'late': now['late'][topic],
            'wrong': now['wrong'][topic],
        }
        return diagnostics.status(f'{self._name}: {topic}', level, message, values)


def _rate(count: int, seconds: float) -> str:
    return f'{count / seconds:.1f}' if seconds else '0.0'
