# SPDX-License-Identifier: Apache-2.0

"""The input of the selector: states, rewards and actions become episodes."""

from __future__ import annotations

import json
import math
import time
from array import array
from collections.abc import Callable
from functools import partial

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from cmifs_ros.collect.discount import Discount
from cmifs_ros.collect.episodes.buffer import EpisodeBuffer
from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.collect.episodes.input_watch import InputWatch, Topic
from cmifs_ros.collect.episodes.pairing import EpisodeAssembler
from cmifs_ros.collect.episodes.reward_reader import RewardReader
from cmifs_ros.collect.json_values import names_of
from cmifs_ros.core import Episode
from cmifs_ros.core.channel_names import MAX_CHANNELS
from cmifs_ros.core.words import counted

from . import conversions, diagnostics
from .following_subscription import FollowingSubscription
from .qos import LATCHED_QOS
from .selector_parameters import MEGABYTE, parse_fields

#: Seconds between two log lines about the number of episodes.
_PROGRESS_PERIOD = 10.0
#: Consecutive states with other channels after which the robot counts as changed.
_FOREIGN_IN_A_ROW = 10


class SelectorInput:
    """Subscribe to states, rewards and actions, and join them into episodes.

    Parameters
    ----------
    node : rclpy.node.Node
    settings : dict
        The node's parameters by name, kept up to date.
    buffer : EpisodeBuffer
        Reported in the status.
    on_state : callable
        Called with the header, names and values of each state.
    on_publishers : callable
        Called when a publisher of states has come or gone.
    on_episode : callable
        Called with each whole episode.
    on_channels : callable
        Called when the channels become known.
    on_restart : callable
        Called if states have had other channels for a while and the parameter
        `restart_on_new_channels` is set; it must clear the assembler.

    Attributes
    ----------
    assembler : EpisodeAssembler

    """

    def __init__(
        self,
        node: Node,
        settings: dict,
        buffer: EpisodeBuffer,
        *,
        on_state: Callable[[Header, list[str], array], None],
        on_publishers: Callable[[], None],
        on_episode: Callable[[Episode], None],
        on_channels: Callable[[], None],
        on_restart: Callable[[], None],
    ):
        self._node, self._settings, self._buffer = node, settings, buffer
        self._on_state, self._on_episode = on_state, on_episode
        self._on_channels, self._on_restart = on_channels, on_restart
        self.assembler = EpisodeAssembler(settings['max_episode_steps'])
        self._watch = InputWatch(self.assembler, buffer)
        self._reward_reader = RewardReader()
        self._is_reward_announced = False
        self._num_foreign = 0
        self._counted_at, self._counted = -math.inf, 0
        self._last_at = dict.fromkeys(('state', 'reward', 'action'), -math.inf)
        self._switched_off: tuple[str, ...] = ()  # Topics, by the sampler.
        node.create_subscription(String, 'switched_off', self._take_switched_off, LATCHED_QOS)
        self.assembler.actions.are_published = self._has_actor
        self.apply()
        self._subscriptions = {
            topic: FollowingSubscription(
                node,
                JointState,
                topic,
                callback,
                on_lost=partial(self._lost, topic),
                on_matched=on_publishers if topic == 'state' else None,
            )
            for topic, callback in (
                ('state', self._take_state),
                ('reward', self._take_reward),
                ('action', self._take_action),
            )
        }

    @property
    def topics(self) -> list[str]:
        """Names of the required topics, after remapping."""
        return [self._subscriptions[topic].topic_name for topic in ('state', 'reward')]

    @property
    def channel_names(self) -> tuple[str, ...] | None:
        """Names of the channels, in the order of the states; None until known."""
        return self.assembler.channel_names

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the actions' values."""
        return self.assembler.actions.names

    @property
    def problem(self) -> str:
        """What is wrong with the input; empty if nothing."""
        found = self._watch.assessment
        return '' if found.level == 'OK' else found.message

    @property
    def target(self) -> str:
        """The target: that of the robot file, otherwise that of the parameters."""
        return self._reward_reader.target or self._settings['target']

    def gamma(self) -> float:
        """Return the discount factor per step: from the robot file, otherwise the parameters.

        Raises
        ------
        ValueError
            If a half-life does not fit the time between steps.

        """
        discount = self._reward_reader.discount
        if discount is None and self._settings['half_life']:
            discount = Discount(half_life=self._settings['half_life'])
        discount = discount or Discount(self._settings['gamma'])
        return discount.per_step(self.assembler.builder.step_seconds)

    def restore_names(
        self, channel_names: tuple[str, ...] | None, action_names: tuple[str, ...]
    ) -> None:
        """Expect the channels and actions of an earlier run."""
        self.assembler.channel_names, self.assembler.actions.names = channel_names, action_names

    def apply(self) -> None:
        """Apply changed parameters."""
        values, reader = self._settings, self.assembler.reader
        self.assembler.builder.max_episode_steps = values['max_episode_steps']
        self.assembler.builder.max_episode_bytes = values['max_buffer_mb'] * MEGABYTE
        tolerance = round(values['stamp_tolerance'] * 1e9)
        self.assembler.stamp_tolerance = self.assembler.actions.tolerance = tolerance
        reader.max_hold_steps, reader.inf_value = values['max_hold_steps'], values['inf_value']
        self._field_reader = conversions.FieldReader(parse_fields(values['fields']))

    def report(self) -> DiagnosticStatus:
        """Log new problems and return the status of the input, once a second."""
        now, assembler = time.monotonic(), self.assembler
        topics = {
            name: Topic(
                now - self._last_at[name],
                'sensor_msgs/msg/JointState',
                subscription.publishers,
                subscription.clashes,
            )
            for name, subscription in self._subscriptions.items()
        }
        self._take(self.assembler.actions.look, now)
        self._log_count(now)
        for line in self._watch.look(now, topics, self._switched_off):
            self._node.get_logger().warning(line)
        values = {
            'episodes': len(self._buffer),
            'steps': self._buffer.num_steps,
            'buffer bytes': self._buffer.nbytes,
            'buffer bytes allowed': self._buffer.max_bytes,
            'transitions': assembler.num_transitions,
            'unpaired messages': assembler.num_pending,
            'steps without action': assembler.actions.num_without,
            'episodes cut': assembler.builder.num_cut,
            'episodes repeated': self._buffer.num_repeated,
            **{f'messages dropped: {k}': n for k, n in assembler.dropped_messages.items()},
            **{f'episodes dropped: {k}': n for k, n in assembler.builder.dropped.items()},
            **{
                f'gaps: {name}': f'{n} of {assembler.reader.num_states}'
                for name, n in assembler.reader.gaps.most_common(8)
            },
        }
        found = self._watch.assessment
        name = f'{diagnostics.name_of(self._node)}: input'
        return diagnostics.status(name, getattr(diagnostics, found.level), found.message, values)

    def _take_switched_off(self, msg: String) -> None:
        try:
            self._switched_off = names_of(json.loads(msg.data), MAX_CHANNELS)
        except (ValueError, TypeError, RecursionError) as error:
            self._node.get_logger().warning(f'switched_off cannot be read: {error!r}')

    def _log_count(self, now: float) -> None:
        count, needed = len(self._buffer), self._settings['min_episodes']
        if count > self._counted < needed and (
            now > self._counted_at + _PROGRESS_PERIOD or count >= needed
        ):
            self._node.get_logger().info(f'{min(count, needed)} of {counted(needed, "episode")}')
            self._counted_at, self._counted = now, count

    def _take_state(self, msg: JointState) -> None:
        self._last_at['state'] = time.monotonic()
        try:
            names, values = self._field_reader.channels_of(msg)
        except ValueError as error:
            self.assembler.drop_message('unusable_state', f'in a state, {error}')
            return
        self._on_state(msg.header, names, values)
        if self.assembler.reader.foreign and self._settings['restart_on_new_channels']:
            self._num_foreign += 1
            if self._num_foreign >= _FOREIGN_IN_A_ROW:
                self._on_restart()
        else:
            self._num_foreign = 0
        stamp = conversions.stamp_to_nanoseconds(msg.header.stamp)
        self._take(self.assembler.add_state, stamp, names, values)

    def _take_reward(self, msg: JointState) -> None:
        self._last_at['reward'] = time.monotonic()
        try:
            sample = self._reward_reader.sample_of(*conversions.named_values(msg))
        except ValueError as error:
            self.assembler.drop_message('malformed_reward', f'in a reward message, {error}')
            return
        if not self._is_reward_announced:
            self._is_reward_announced = True
            self._announce(sample)
        self._take(
            self.assembler.add_reward, conversions.stamp_to_nanoseconds(msg.header.stamp), sample
        )

    def _has_actor(self) -> bool:
        """Return whether anybody publishes actions."""
        # To count publishers takes as long as all the rest of a step.
        return self._subscriptions['action'].is_matched

    def _take_action(self, msg: JointState) -> None:
        self._last_at['action'] = time.monotonic()
        stamp = conversions.stamp_to_nanoseconds(msg.header.stamp)
        try:
            names, values = conversions.named_values(msg)
        except ValueError as error:
            self.assembler.drop_message('malformed_action', f'in an action, {error}')
            return
        self._take(self.assembler.actions.add_action, stamp, names, values)

    def _take(self, add: Callable[..., list[Episode]], *message) -> None:
        were_known = self.assembler.channel_names is not None
        episodes = add(*message)
        if not were_known and self.assembler.channel_names is not None:
            self._on_channels()
        for episode in episodes:
            self._on_episode(episode)

    def _lost(self, topic: str, count: int) -> None:
        self.assembler.drop_message(
            'lost_on_the_way',
            f'{counted(count, "message")} of {topic} lost by the middleware: they arrive faster '
            'than they are processed',
            count=count,
        )

    def _announce(self, sample: RewardSample) -> None:
        if not sample.marks_ends:
            ends = ['when `episode` changes'] if sample.episode is not None else []
            ends += ['when `step` is 0 again'] if sample.step is not None else []
            ends += [f'at max_episode_steps={self._settings["max_episode_steps"]}']
            self._node.get_logger().info(
                'the reward messages have neither `terminated` nor `truncated`: an episode is '
                f'closed {" or ".join(ends)}'
            )
        if sample.step is None:
            self._node.get_logger().info(
                'the reward messages have no `step`: a lost state goes unnoticed, and the first '
                'episode may lack its beginning'
            )
