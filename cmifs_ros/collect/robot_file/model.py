# SPDX-License-Identifier: Apache-2.0

"""The contents of a robot file as plain objects."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

from cmifs_ros.collect.discount import Discount
from cmifs_ros.collect.encoders import Encoder
from cmifs_ros.collect.sensor_groups import groups_by_name
from cmifs_ros.core.words import counted, first

from .expression import FUNCTIONS, Expression
from .field_path import FieldPath, MissingFieldError, described

#: Values that the sampler provides for expressions.
OWN_VALUES = frozenset({'step', 'succeeded', 'aborted', 'canceled'})
#: Names with a meaning in expressions, which no channel or value can have.
RESERVED_NAMES = OWN_VALUES | set(FUNCTIONS) | {'before'}
#: Summaries of the messages between two steps.
SUMMARIES = ('mean', 'rms', 'min', 'max', 'std', 'count')
#: Roles of a source.
CHANNEL, VALUE, ACTION = 'channel', 'value', 'action'
#: What may distinguish the robots of several bags.
SOURCES = ('none', 'bag', 'folder')
STATUS = '/_action/status'


class UnlistedCategoryError(Exception):
    """A message has a category that `one_hot` does not list."""


@dataclass(frozen=True)
class Source:
    """One entry of `channels`, `values` or `actions`: one or several numbers of a topic.

    Attributes
    ----------
    name : str
    path : FieldPath
    encoder : Encoder or None
        What turns the message at the path into numbers: a quaternion, an image, a scan, a cloud.
    max_age : float
        Seconds for which a message is valid; `inf` for latched topics.
    inf : str or None
        Field of the message whose value replaces +inf.
    one_hot : tuple of str
        Its categories, whole numbers or words; the channel of each is 1 if it is the value, else 0.
    role : str
        `CHANNEL`, `VALUE` (for the reward and ends only), or `ACTION`.
    over : tuple of str
        Which of `SUMMARIES` of the messages between two steps; empty: the newest message.
    words : tuple of str
        The words that the reward and ends compare this text with; empty if it is not a text.
        Its value for each word is 1 if it is the word, else 0.

    """

    name: str
    path: FieldPath
    encoder: Encoder | None = None
    max_age: float = 1.0
    inf: str | None = None
    one_hot: tuple[str, ...] = ()
    role: str = CHANNEL
    over: tuple[str, ...] = ()
    words: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its channels, such as `yaw.sin`, `scan[30]`, `shake.rms`, or its own."""
        parts = self.over if len(self.over) > 1 else self.one_hot or self.words
        suffixes = tuple(f'.{part}' for part in parts) or self.path.suffixes
        if self.encoder is not None:
            suffixes = self.encoder.suffixes
        return tuple(self.name + suffix for suffix in suffixes)

    def readings(self, message) -> list[float]:
        """Return its values in a message, possibly none; see `FieldPath.values_in`.

        There are as many as `names`, except with several summaries.

        Raises
        ------
        MissingFieldError
        UnlistedCategoryError

        """
        if self.encoder is not None:
            return [n for part in self.path.values_in(message) for n in self._encoded(part)]
        if self.one_hot:
            return [part for one in self.path.values_in(message) for part in self._one_hot(one)]
        if self.words:
            return [part for text in self.path.values_in(message) for part in self._words(text)]
        values = self.path.numbers_in(message)
        if self.inf is not None:
            instead = FieldPath(self.path.topic, (self.inf,)).numbers_in(message)[0]
            values = [instead if value == math.inf else value for value in values]
        return values

    def _one_hot(self, value) -> list[float]:
        number = 0.5 if isinstance(value, str) else self.path.as_number(value)
        category = str(int(number) if number.is_integer() else value)
        if category not in self.one_hot:
            raise UnlistedCategoryError(
                f'{self.path} is {category[:40]!r}; expected one of {first(self.one_hot)} (one_hot)'
            )
        return [float(category == one) for one in self.one_hot]

    def _words(self, value) -> list[float]:
        if not isinstance(value, str):
            raise MissingFieldError(
                f'{self.path} is {described(value)}; expected a text, as {self.name} is compared '
                f'with {self.words[0]!r}'
            )
        return [float(value == word) for word in self.words]

    def _encoded(self, value) -> list[float]:
        assert self.encoder is not None
        if not self.encoder.fits(lambda name: hasattr(value, name)):
            raise MissingFieldError(
                f'{self.path} is {described(value)}; expected {self.encoder.expected} for '
                f'as: {self.encoder.name}'
            )
        try:
            values = [float(number) for number in self.encoder.encode(value)]
        except ValueError as error:
            raise MissingFieldError(f'{self.path} has {error}') from None
        except Exception as error:  # The encoder of another package may raise anything.
            said = f'{type(error).__name__}: {" ".join(str(error).split())[:200]}'
            raise MissingFieldError(
                f'{self.path}: as: {self.encoder.name} fails ({said})'
            ) from error
        if len(values) != len(self.encoder.suffixes):
            raise MissingFieldError(
                f'{self.path}: as: {self.encoder.name} gives {counted(len(values), "value")}; '
                f'expected {len(self.encoder.suffixes)}'
            )
        return values


@dataclass(frozen=True)
class SavingCycle:
    """When unneeded topics are switched off, and when they come back.

    Attributes
    ----------
    after : int
        Number of consecutive selections that must agree.
    explore_every : int
        Number of episodes with topics switched off, after which all come back.
    explore_episodes : int
        Number of complete episodes with all topics on.

    """

    after: int = 3
    explore_every: int = 50
    explore_episodes: int = 10


@dataclass(frozen=True)
class RobotFile:
    """A robot file.

    Attributes
    ----------
    step_topic : str or None
        The topic with a step at each message; None with a rate.
    rate : float or None
        Steps per second; None with a topic.
    sources : tuple of Source
    reward, terminated, truncated : Expression, FieldPath or None
        A path stands for its topic's values until the next step. Without a reward it is 0.
    action : str or None
        Action whose goals are the episodes.
    steps : int or None
        Number of steps after which an episode is truncated.
    types : dict of str to str
        Types that the file gives, by topic.
    discount : Discount or None
        The discount, if the file gives one.
    source : str
        What distinguishes the robots of several bags: one of `SOURCES`.
    target : str or None
        One of `TARGETS`, if the file gives one.
    saving : SavingCycle or None
        None: no topic is ever switched off.

    """

    step_topic: str | None
    rate: float | None
    sources: tuple[Source, ...]
    reward: Expression | FieldPath | None
    terminated: Expression | FieldPath | None = None
    truncated: Expression | FieldPath | None = None
    action: str | None = None
    steps: int | None = None
    types: dict[str, str] | None = None
    discount: Discount | None = None
    source: str = 'none'
    target: str | None = None
    saving: SavingCycle | None = None

    @property
    def channel_names(self) -> tuple[str, ...]:
        """The channels of a state, in order."""
        return self._names_of(CHANNEL)

    @property
    def action_names(self) -> tuple[str, ...]:
        """The values of an action, in order."""
        return self._names_of(ACTION)

    def _names_of(self, role: str) -> tuple[str, ...]:
        return tuple(name for s in self.sources if s.role == role for name in s.names)

    @property
    def channel_topics(self) -> dict[str, str]:
        """The topic of each channel."""
        return {name: s.path.topic for s in self.sources if s.role == CHANNEL for name in s.names}

    @property
    def reward_channels(self) -> tuple[str, ...]:
        """The channels that the reward is computed from."""
        used = self.reward.names if isinstance(self.reward, Expression) else ()
        return tuple(
            source.name
            for source in self.sources
            if source.role == CHANNEL and (source.name in used or source.path == self.reward)
        )

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Sensors of several channels, grouped by the same rule as in the selector."""
        return groups_by_name(self.channel_names)

    @property
    def topics(self) -> tuple[str, ...]:
        """All topics that the file uses, each once."""
        return self.topics_for([source.name for source in self.sources])

    @property
    def large_topics(self) -> frozenset[str]:
        """Topics of images and clouds, few of whose messages fit into memory."""
        return frozenset(s.path.topic for s in self.sources if s.encoder and s.encoder.is_large)

    def topics_for(self, channels: Collection[str]) -> tuple[str, ...]:
        """Return the topics of some channels, and of actions, steps, reward and ends."""
        rules = (self.reward, self.terminated, self.truncated)
        names = set(channels).union(*(r.names for r in rules if isinstance(r, Expression)))
        paths = [
            source.path
            for source in self.sources
            if source.role == ACTION or not names.isdisjoint((source.name, *source.names))
        ]
        paths += [rule for rule in rules if isinstance(rule, FieldPath)]
        own = [self.step_topic] if self.step_topic else []
        own += [self.action + STATUS] if self.action else []
        return tuple(dict.fromkeys(own + [path.topic for path in paths]))

    def type_problem(self, topic: str, kinds: Collection[str]) -> str:
        """Return what is wrong with a topic of these types; empty if nothing."""
        said = (self.types or {}).get(topic)
        if said is None or said in kinds:
            return ''
        return (
            f'{topic} is of type {", ".join(sorted(kinds))}, not {said} as in the robot file: '
            'correct or remove its `type`'
        )
