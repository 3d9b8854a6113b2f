"""The selector node: collects episodes, selects sensors, republishes only those."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import time
from collections import Counter
from concurrent.futures import Future
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_policy_name_from_kind
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, Int32MultiArray
from std_srvs.srv import Trigger

from cmifs_ros.collect import episode_file
from cmifs_ros.collect.drift import Drift
from cmifs_ros.collect.episode_buffer import EpisodeBuffer
from cmifs_ros.collect.episode_file import Saved
from cmifs_ros.collect.episode_saver import EpisodeSaver
from cmifs_ros.collect.reward_reader import RewardReader
from cmifs_ros.collect.state_filter import StateFilter
from cmifs_ros.collect.transitions import EpisodeAssembler, RewardSample, listed
from cmifs_ros.core import Episode
from cmifs_ros.core.selection import Selection

from . import conversions, diagnostics
from .deferred_service import answer_later
from .parameters import declare
from .selection_queue import Job, Outcome, RefusedError, SelectionQueue
from .selector_parameters import (
    PARAMETERS,
    SELECTION_PARAMETERS,
    check_parameters,
    parse_kdr_target,
    parse_sensor_groups,
)

STREAM_QOS = QoSProfile(depth=1000)
LATCHED_QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

#: Seconds between looks at the worker.
_POLL_PERIOD = 0.1
#: Seconds between two warnings of dropped messages.
_WARNING_PERIOD = 10.0
#: Seconds without a state after which the input counts as silent.
_SILENCE = 5.0

MEGABYTE = 1_000_000

NOTHING_SELECTED = 'no sensor tells anything about the return'
CLEARED_MEANWHILE = 'the selection is not used: its episodes were cleared meanwhile'


class SelectorNode(Node):
    """Publish the sensors that the return depends on, and the state reduced to them."""

    def __init__(self):
        super().__init__('selector')
        self._settings = declare(self, PARAMETERS, check_parameters, self._apply_parameters)
        max_bytes = self._settings['max_buffer_mb'] * MEGABYTE
        self._buffer = EpisodeBuffer(self._max_episodes, max_bytes)
        self._assembler = EpisodeAssembler(self._settings['max_episode_steps'], max_bytes)
        self._reward_reader = RewardReader()
        self._queue = SelectionQueue(
            self._make_job,
            lambda: self._revision,
            self._on_outcome,
            self._settings['selection_timeout'],
        )
        self._revision = 0  # counts what would change a selection
        self._attempted_revision: int | None = 0  # None: the last attempt failed
        self._generation = 0  # counts how often the episodes were thrown away
        self._selection: Selection | None = None
        self._selected_at = -math.inf
        self._filter: StateFilter | None = None
        self._drift: Drift | None = None
        self._selected_state = JointState()
        self._last_error = ''
        self._last_at = {'state': -math.inf, 'reward': -math.inf}
        self._status_name = self.get_fully_qualified_name().lstrip('/')
        self._is_reward_announced = False
        self._incompatible: dict[str, str] = {}
        #: By topic, what was not yet warned of: the policy, and since when.
        self._new_incompatible: dict[str, tuple[str, float]] = {}
        self._warned_at = -math.inf
        self._warned_drops: Counter[str] = Counter()
        self._saver: EpisodeSaver | None = None
        self._warned_storage = self._storage_error = ''

        self._indices_publisher = self.create_publisher(
            Int32MultiArray, 'selected_indices', LATCHED_QOS
        )
        self._scores_publisher = self.create_publisher(JointState, 'scores', LATCHED_QOS)
        self._state_publisher = self.create_publisher(JointState, 'selected_state', STREAM_QOS)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._inputs = {}
        for topic, callback in (('state', self._on_state), ('reward', self._on_reward)):
            events = SubscriptionEventCallbacks(
                incompatible_qos=partial(self._on_incompatible_qos, topic),
                message_lost=partial(self._on_message_lost, topic),
            )
            self._inputs[topic] = self.create_subscription(
                JointState, topic, callback, STREAM_QOS, event_callbacks=events
            )
        # The usual depth of 10 would lose calls that come in a burst.
        answer_later(
            self.create_service(
                Trigger, 'select_features', self._on_select_features, qos_profile=STREAM_QOS
            )
        )
        self.create_service(Trigger, '~/clear_episodes', self._on_clear_episodes)
        # Steady time: a simulated clock that stands still must not stop the node.
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_POLL_PERIOD, self._queue.poll, clock=self._steady_clock)
        self.create_timer(1.0, self._report, clock=self._steady_clock)
        self._selection_timer = None
        self._set_selection_period(self._settings['selection_period'])
        if self._settings['episodes_path']:
            self._restore(os.path.abspath(self._settings['episodes_path']))

    def destroy_node(self) -> None:
        """End the worker process and the last save, then the node."""
        self._queue.stop()
        if self._saver is not None:
            self._saver.stop()
        super().destroy_node()

    @property
    def _max_episodes(self) -> int:
        return max(self._settings['max_episodes'], self._settings['min_episodes'])

    # --- data in

    def _on_state(self, msg: JointState) -> None:
        self._last_at['state'] = time.monotonic()
        self._relay(msg)
        try:
            names, values = conversions.named_values(msg)
        except ValueError as error:
            self._assembler.drop_message('too_large', f'in a state, {error}')
            return
        stamp = conversions.stamp_to_nanoseconds(msg.header.stamp)
        were_known = self._assembler.channel_names is not None
        episodes = self._assembler.add_state(stamp, names, values)
        if episodes:
            self._keep(episodes)
        if not were_known and self._assembler.channel_names is not None:
            self._on_new_channels()

    def _on_reward(self, msg: JointState) -> None:
        self._last_at['reward'] = time.monotonic()
        try:
            sample = self._reward_reader.read(*conversions.named_values(msg))
        except ValueError as error:
            self._assembler.drop_message('malformed_reward', f'in a reward message, {error}')
            return
        if not self._is_reward_announced:
            self._is_reward_announced = True
            self._announce(sample)
        stamp = conversions.stamp_to_nanoseconds(msg.header.stamp)
        episodes = self._assembler.add_reward(stamp, sample)
        if episodes:
            self._keep(episodes)

    def _on_incompatible_qos(self, topic: str, event) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        self._new_incompatible[topic] = policy, time.monotonic()

    def _on_message_lost(self, topic: str, event) -> None:
        self._assembler.drop_message(
            f'lost_{topic}',
            f'{event.total_count_change} messages of {topic} on their way',
            count=event.total_count_change,
        )

    def _publishing_nodes(self, topic: str) -> list[str]:
        publishers = self.get_publishers_info_by_topic(self._inputs[topic].topic_name)
        return sorted(f'{p.node_namespace.rstrip("/")}/{p.node_name}' for p in publishers)

    def _announce(self, sample: RewardSample) -> None:
        if not sample.marks_ends:
            ends = 'where `episode` changes or' if sample.episode is not None else 'only'
            self.get_logger().info(
                'the reward messages carry neither `terminated` nor `truncated`: an episode is '
                f'closed {ends} at max_episode_steps={self._settings["max_episode_steps"]}'
            )
        if sample.step is None:
            self.get_logger().info(
                'the reward messages carry no `step`: a lost state cannot be noticed, and the '
                'first episode may lack its beginning'
            )

    def _keep(self, episodes: list[Episode]) -> None:
        for episode in episodes:
            self._buffer.append(episode)
            self._revision += 1
            if self._drift is not None:
                self._drift.add(episode)
            if self._saver is not None and not self._saver.append(
                episode, self._assembler.channel_names
            ):
                self._save()

    # --- data out

    def _relay(self, msg: JointState) -> None:
        names, values = msg.name, msg.position
        if len(names) != len(values):
            return
        if self._filter is not None:
            values = self._filter.pick(names, values)
            names = self._filter.names
        elif not self._settings['pass_through_until_selected']:
            return
        # Publishing is most of the work, also for nobody.
        if values is not None and self._state_publisher.get_subscription_count():
            out = self._selected_state  # One message for all: a new one takes as long to make.
            out.header, out.name, out.position = msg.header, names, values
            self._state_publisher.publish(out)

    def _on_new_channels(self) -> None:
        """Return to the beginning if the channels, new after a clear, lack a selected one."""
        names = self._assembler.channel_names
        selected = set(self._selection.names) if self._selection is not None else set()
        missing = selected - set(names)
        if missing:
            self.get_logger().warning(
                f'the selection is dropped: {listed(sorted(missing))} is not among the new '
                f'channels {listed(names)}'
            )
            self._selection = self._filter = self._drift = None
        self._save()  # Now episodes with these channels can be appended.

    # --- selections

    def _on_select_features(self, request, response) -> Future:
        answer = Future()

        def on_outcome(outcome: Outcome) -> None:
            response.success = not outcome.error
            response.message = json.dumps(self._reply(outcome))
            answer.set_result(response)

        self._queue.request(on_outcome)
        return answer

    def _reply(self, outcome: Outcome) -> dict:
        if outcome.selection is None:
            return {
                'error': outcome.error,
                'episodes': len(self._buffer),
                'min_episodes': self._settings['min_episodes'],
            }
        reply = dataclasses.asdict(outcome.selection)
        del reply['means'], reply['spreads']
        return reply | {'error': outcome.error} if outcome.error else reply

    def _make_job(self) -> Job:
        self._attempted_revision = self._revision
        values = self._settings
        if len(self._buffer) < values['min_episodes']:
            raise RefusedError(
                f'there are {len(self._buffer)} episodes; a selection needs at least '
                f'{values["min_episodes"]} (min_episodes)'
            )
        settings = {
            'num_features': values['num_features'] or None,
            'direction': values['direction'],
            'groups': parse_sensor_groups(values['sensor_groups']),
            'random_state': values['random_state'],
        }
        if values['method'] == 'kdr':
            settings['target'] = parse_kdr_target(values['kdr_target'])
        else:
            settings |= {
                'gamma': values['gamma'],
                'criterion': values['criterion'],
                'standardize': values['standardize'],
                'max_time_bins': values['max_time_bins'] or None,
            }
        episodes, names = self._buffer.snapshot(), self._assembler.channel_names
        arguments = (episodes, names, values['method'], settings, values['worker_threads'])
        return Job(self._revision, self._generation, arguments)

    def _select_periodically(self) -> None:
        enough = len(self._buffer) >= self._settings['min_episodes']
        if enough and not self._queue.busy and self._revision != self._attempted_revision:
            self._queue.request(lambda outcome: None)

    def _on_outcome(self, outcome: Outcome) -> Outcome:
        selection = outcome.selection
        if outcome.is_refusal:  # Whoever asked is told why; nothing is wrong.
            return outcome
        if outcome.generation != self._generation:
            self.get_logger().info(CLEARED_MEANWHILE)
            return dataclasses.replace(outcome, error=outcome.error or CLEARED_MEANWHILE)
        self._last_error = outcome.error
        if selection is None:
            self._attempted_revision = None
            self.get_logger().warning(f'no selection: {outcome.error}')
            return outcome
        evidence = (
            f'{selection.episodes} episodes, {selection.steps} steps, {selection.seconds:.1f} s; '
            + ', '.join(
                f'{name} {score:.3f}'
                for name, score in zip(selection.ranking, selection.scores, strict=True)
            )
        )
        if not selection.indices:
            self._last_error = NOTHING_SELECTED
            self.get_logger().warning(f'{NOTHING_SELECTED}: {evidence}')
            return dataclasses.replace(outcome, error=NOTHING_SELECTED)
        self._use(selection, time.monotonic())
        self._save()
        self.get_logger().info(f'selected {", ".join(selection.names)}: {evidence}')
        return outcome

    def _use(self, selection: Selection, selected_at: float) -> None:
        self._selection, self._selected_at = selection, selected_at
        self._filter = StateFilter(selection.names)
        self._drift = Drift(selection, self._settings['min_episodes'])
        self._indices_publisher.publish(conversions.indices_to_msg(selection.indices))
        header = Header(stamp=self.get_clock().now().to_msg())
        gains = [b - a for a, b in zip((0.0, *selection.scores), selection.scores, strict=False)]
        self._scores_publisher.publish(
            conversions.named_values_to_msg(header, selection.ranking, gains)
        )

    # --- storage

    def _restore(self, path: str) -> None:
        """Take up what the last run left; a file that cannot be used is kept aside."""
        self._saver = EpisodeSaver(path)
        try:
            saved = episode_file.read(path, self._buffer.max_episodes, self._buffer.max_bytes)
        except FileNotFoundError:
            return
        except (OSError, episode_file.RefusedFileError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            try:
                aside = f'is kept as {episode_file.set_aside(path)}'
            except OSError as failure:  # Nor may it be overwritten.
                self._saver.stop()
                self._saver = None
                aside = f'stays ({failure.strerror}), and nothing is saved'
            self._storage_error = f'{path} {reason}; it {aside}, and the selector starts empty'
            return
        for episode in saved.episodes:
            self._buffer.append(episode)
        self._assembler.channel_names = saved.channel_names
        self._revision += 1
        if saved.selection is not None:
            age = max(0.0, time.time() - saved.selected_at)
            self._use(saved.selection, time.monotonic() - age)
        names = saved.selection.names if saved.selection is not None else ['nothing']
        self.get_logger().info(
            f'{path}: {len(saved.episodes)} episodes are back, and the selection of {listed(names)}'
        )
        if saved.torn_bytes:
            self.get_logger().warning(
                f'{path} ends with {saved.torn_bytes} bytes of an episode that was being saved '
                'when the last run was killed; that episode is lost'
            )
        self._save()

    def _save(self) -> None:
        if self._saver is not None:
            selected_at = time.time() - (time.monotonic() - self._selected_at)
            self._saver.save(
                Saved(
                    self._assembler.channel_names,
                    self._buffer.snapshot(),
                    self._selection,
                    selected_at if self._selection is not None else 0.0,
                )
            )

    # --- upkeep

    def _apply_parameters(self, changed: dict) -> None:
        if changed.keys() & SELECTION_PARAMETERS:
            self._revision += 1
            self._last_error = ''
        if {'min_episodes', 'max_episodes'} & changed.keys():
            self._buffer.max_episodes = self._max_episodes
        if 'max_buffer_mb' in changed:
            self._buffer.max_bytes = changed['max_buffer_mb'] * MEGABYTE
            self._assembler.max_episode_bytes = self._buffer.max_bytes
        if 'max_episode_steps' in changed:
            self._assembler.max_episode_steps = changed['max_episode_steps']
        if 'selection_timeout' in changed:
            self._queue.timeout = changed['selection_timeout']
        if 'selection_period' in changed:
            self._set_selection_period(changed['selection_period'])

    def _set_selection_period(self, seconds: float) -> None:
        if self._selection_timer is not None:
            self.destroy_timer(self._selection_timer)
            self._selection_timer = None
        if seconds > 0:
            self._selection_timer = self.create_timer(
                seconds, self._select_periodically, clock=self._steady_clock
            )

    def _on_clear_episodes(self, request, response):
        response.success = True
        response.message = json.dumps({'episodes': len(self._buffer)})
        self._buffer.clear()
        self._assembler.clear()
        self._revision += 1
        self._generation += 1
        self._last_error = ''
        self._drift = None
        self._save()
        self.get_logger().info(f'cleared {response.message}')
        return response

    def _report(self) -> None:
        self._warn_of_incompatible_qos()
        self._warn_of_drops()
        self._warn_of_storage()
        statuses = [self._input_status(), self._selection_status()]
        if self._settings['episodes_path']:
            statuses.append(self._storage_status())
        self._diagnostics_publisher.publish(
            diagnostics.diagnostic_array(self.get_clock().now().to_msg(), *statuses)
        )

    def _warn_of_incompatible_qos(self) -> None:
        for topic, (policy, since) in list(self._new_incompatible.items()):
            nodes = self._publishing_nodes(topic)
            # The name of a node becomes known a little later than its publisher, if at all.
            if any('_UNKNOWN_' in node for node in nodes) and time.monotonic() < since + _SILENCE:
                continue
            del self._new_incompatible[topic]
            self._incompatible[topic] = (
                f'a publisher of {topic} offers a QoS with which nothing can be received '
                f'({policy}); publishers: {listed(nodes)}'
            )
            self.get_logger().warning(self._incompatible[topic])

    def _warn_of_drops(self) -> None:
        now = time.monotonic()
        drops = self._assembler.dropped_messages + self._assembler.dropped_episodes
        if drops == self._warned_drops or now < self._warned_at + _WARNING_PERIOD:
            return
        counts = ', '.join(f'{n} {cause}' for cause, n in (drops - self._warned_drops).items())
        self.get_logger().warning(f'dropped {counts}; the last: {self._assembler.last_drop}')
        self._warned_at, self._warned_drops = now, drops

    def _warn_of_storage(self) -> None:
        if self._saver is not None and (self._saver.num_saves or self._saver.error):
            self._storage_error = self._saver.error
        if self._storage_error not in ('', self._warned_storage):
            self.get_logger().error(self._storage_error)
        self._warned_storage = self._storage_error

    def _input_status(self):
        assembler = self._assembler
        now = time.monotonic()
        silence = {topic: now - last for topic, last in self._last_at.items()}
        recently_warned = now - self._warned_at < 2 * _WARNING_PERIOD
        rivals = [topic for topic in self._inputs if len(self._publishing_nodes(topic)) > 1]
        if self._incompatible and max(silence.values()) > _SILENCE:
            level, message = diagnostics.WARN, '; '.join(self._incompatible.values())
        elif silence['state'] == math.inf:
            level, message = diagnostics.WARN, 'no state has come yet'
        elif silence['state'] > _SILENCE:
            level, message = diagnostics.STALE, f'no state for {silence["state"]:.0f} s'
        elif silence['reward'] > _SILENCE:
            level, message = diagnostics.WARN, f'states come, but no reward for {_SILENCE:.0f} s'
        elif rivals:
            level = diagnostics.WARN
            message = (
                f'more than one node publishes {listed(rivals)}, so that episodes may be mixed: '
                f'{listed(self._publishing_nodes(rivals[0]))}'
            )
        elif recently_warned:
            level, message = diagnostics.WARN, f'dropping; the last: {assembler.last_drop}'
        else:
            level, message = diagnostics.OK, 'collecting'
        values = {
            'episodes': len(self._buffer),
            'steps': self._buffer.num_steps,
            'buffer bytes': self._buffer.nbytes,
            'buffer bytes allowed': self._buffer.max_bytes,
            'transitions': assembler.num_transitions,
            'unpaired messages': assembler.num_pending,
            'episodes cut': assembler.num_cut,
            **{f'messages dropped: {k}': n for k, n in assembler.dropped_messages.items()},
            **{f'episodes dropped: {k}': n for k, n in assembler.dropped_episodes.items()},
        }
        return diagnostics.status(f'{self._status_name}: input', level, message, values)

    def _selection_status(self):
        selection = self._selection
        values = {
            'worker': 'computing' if self._queue.busy else 'idle',
            'worker pid': self._queue.worker_pid or 'none',
            'computing for s': f'{self._queue.running_for:.1f}',
            'parameters': json.dumps(self._settings),
        }
        changed = [] if self._drift is None else self._drift.changed()
        if selection is not None:
            values |= {
                'names': listed(selection.names),
                'indices': listed([str(index) for index in selection.indices]),
                'age in s': f'{time.monotonic() - self._selected_at:.0f}',
                'episodes used': selection.episodes,
                'seconds taken': f'{selection.seconds:.2f}',
                'states without a selected channel': self._filter.num_lacking,
            }
        if self._last_error:
            level, message = diagnostics.ERROR, self._last_error
        elif selection is None:
            level = diagnostics.OK
            message = (
                f'no selection yet; {len(self._buffer)} episodes of at least '
                f'{self._settings["min_episodes"]}'
            )
        elif self._filter.is_lacking:
            level, message = diagnostics.WARN, 'the newest state lacks a selected channel'
        elif changed:
            names = (*self._assembler.channel_names, 'the reward')
            level = diagnostics.WARN
            message = (
                'the data have changed since the selection: '
                f'{listed([names[channel] for channel in changed])}'
            )
        else:
            level, message = diagnostics.OK, f'selected {values["names"]}'
        return diagnostics.status(f'{self._status_name}: selection', level, message, values)

    def _storage_status(self):
        values = {'path': self._settings['episodes_path']}
        if self._saver is not None:
            values |= {
                'saves': self._saver.num_saves,
                'file bytes': self._saver.nbytes,
                'seconds of the last save': f'{self._saver.seconds:.3f}',
            }
        level = diagnostics.ERROR if self._storage_error else diagnostics.OK
        message = self._storage_error or 'saving'
        return diagnostics.status(f'{self._status_name}: storage', level, message, values)
