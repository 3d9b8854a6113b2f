"""The selector node: collects episodes, selects sensors, republishes only those."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections import Counter

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, Int32MultiArray
from std_srvs.srv import Trigger

from cmifs_ros.core import Episode, EpisodeBuffer
from cmifs_ros.core.selection import Selection

from . import conversions, diagnostics
from .parameters import declare
from .selection_queue import Job, Outcome, RefusedError, SelectionQueue
from .selector_parameters import (
    PARAMETERS,
    SELECTION_PARAMETERS,
    check_parameters,
    parse_kdr_target,
    parse_sensor_groups,
)
from .transitions import EpisodeAssembler

STREAM_QOS = QoSProfile(depth=1000)
LATCHED_QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

#: Seconds between looks at the worker.
_POLL_PERIOD = 0.1
#: Seconds between two warnings of dropped messages.
_WARNING_PERIOD = 10.0
#: Seconds without a state after which the input counts as silent.
_SILENCE = 5.0

NOTHING_SELECTED = 'no sensor tells anything about the return'


class SelectorNode(Node):
    """Publish the sensors that the return depends on, and the state reduced to them."""

    def __init__(self):
        super().__init__('selector')
        self._settings = declare(self, PARAMETERS, check_parameters, self._apply_parameters)
        self._buffer = EpisodeBuffer(self._settings['max_episodes'])
        self._assembler = EpisodeAssembler(self._settings['max_episode_steps'])
        self._queue = SelectionQueue(self._make_job, lambda: self._revision, self._on_outcome)
        self._revision = 0  # counts what would change a selection
        self._attempted_revision: int | None = 0  # None: the last attempt failed
        self._generation = 0  # counts how often the episodes were thrown away
        self._selection: Selection | None = None
        self._selected_at = -math.inf
        self._last_error = ''
        self._last_state_at = -math.inf
        self._relay_names: tuple[str, ...] | None = None
        self._relay_columns: list[int] | None = None
        self._num_not_relayed = 0
        self._status_name = self.get_fully_qualified_name().lstrip('/')
        self._is_reward_announced = False
        self._warned_at = -math.inf
        self._warned_drops: Counter[str] = Counter()

        self._indices_publisher = self.create_publisher(
            Int32MultiArray, 'selected_indices', LATCHED_QOS
        )
        self._scores_publisher = self.create_publisher(JointState, 'scores', LATCHED_QOS)
        self._state_publisher = self.create_publisher(JointState, 'selected_state', STREAM_QOS)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_subscription(JointState, 'state', self._on_state, STREAM_QOS)
        self.create_subscription(JointState, 'reward', self._on_reward, STREAM_QOS)
        # A call waits for its selection; in a group of its own it holds up nothing. The usual
        # depth of 10 would lose calls that come in a burst.
        self.create_service(
            Trigger,
            'select_features',
            self._on_select_features,
            qos_profile=STREAM_QOS,
            callback_group=ReentrantCallbackGroup(),
        )
        self.create_service(Trigger, '~/clear_episodes', self._on_clear_episodes)
        # Steady time: a simulated clock that stands still must not stop the node.
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_POLL_PERIOD, self._queue.poll, clock=self._steady_clock)
        self.create_timer(1.0, self._report, clock=self._steady_clock)
        self._selection_timer = None
        self._set_selection_period(self._settings['selection_period'])

    def destroy_node(self) -> None:
        """End the worker process, then the node."""
        self._queue.stop()
        super().destroy_node()

    # --- data in

    def _on_state(self, msg: JointState) -> None:
        self._last_state_at = time.monotonic()
        names, values = conversions.named_values(msg)
        stamp = conversions.stamp_to_nanoseconds(msg.header.stamp)
        self._relay(msg.header, names, msg.position)
        were_known = self._assembler.channel_names is not None
        self._keep(self._assembler.add_state(stamp, names, values))
        if not were_known and self._assembler.channel_names is not None:
            self._drop_foreign_selection()

    def _on_reward(self, msg: JointState) -> None:
        try:
            sample = conversions.reward_sample(msg)
        except ValueError as error:
            self._assembler.drop_message('malformed_reward', f'in a reward message, {error}')
            return
        if not self._is_reward_announced:
            self._is_reward_announced = True
            self._announce(sample)
        stamp = conversions.stamp_to_nanoseconds(msg.header.stamp)
        self._keep(self._assembler.add_reward(stamp, sample))

    def _announce(self, sample) -> None:
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

    # --- data out

    def _relay(self, header: Header, names: tuple[str, ...], positions) -> None:
        if len(names) != len(positions):
            return
        if self._selection is None:
            if self._settings['pass_through_until_selected']:
                self._state_publisher.publish(
                    conversions.named_values_to_msg(header, names, positions)
                )
            return
        if names != self._relay_names:
            self._relay_names = names
            missing = set(self._selection.names) - set(names)
            self._relay_columns = (
                None if missing else [names.index(name) for name in self._selection.names]
            )
        if self._relay_columns is None:
            self._num_not_relayed += 1
        else:
            self._state_publisher.publish(
                JointState(
                    header=header,
                    name=self._selection.names,
                    position=[positions[i] for i in self._relay_columns],
                )
            )

    def _drop_foreign_selection(self) -> None:
        """Return to the beginning if the channels, new after a clear, lack a selected one."""
        if self._selection is None:
            return
        missing = set(self._selection.names) - set(self._assembler.channel_names)
        if missing:
            self.get_logger().warning(
                f'the selection is dropped: {", ".join(sorted(missing))} is not among the new '
                f'channels {", ".join(self._assembler.channel_names)}'
            )
            self._selection = None

    # --- selections

    async def _on_select_features(self, request, response):
        outcome = await self._queue.request()
        response.success = outcome.selection is not None and bool(outcome.selection.indices)
        response.message = json.dumps(self._reply(outcome))
        return response

    def _reply(self, outcome: Outcome) -> dict:
        if outcome.selection is None:
            return {
                'error': outcome.error,
                'episodes': len(self._buffer),
                'min_episodes': self._settings['min_episodes'],
            }
        reply = dataclasses.asdict(outcome.selection)
        if not outcome.selection.indices:
            reply['error'] = NOTHING_SELECTED
        return reply

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
                'n_jobs': values['worker_threads'],
            }
        episodes, names = self._buffer.snapshot(), self._assembler.channel_names
        arguments = (episodes, names, values['method'], settings)
        return Job(self._revision, self._generation, arguments)

    def _select_periodically(self) -> None:
        enough = len(self._buffer) >= self._settings['min_episodes']
        if enough and not self._queue.busy and self._revision != self._attempted_revision:
            self._queue.request()

    def _on_outcome(self, outcome: Outcome) -> None:
        if outcome.is_refusal:  # Whoever asked is told why; nothing is wrong.
            return
        if outcome.generation != self._generation:
            self.get_logger().info('a selection is not used: its episodes were cleared meanwhile')
            return
        selection = outcome.selection
        self._last_error = outcome.error
        if selection is None:
            self._attempted_revision = None
            self.get_logger().warning(f'no selection: {outcome.error}')
            return
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
            return
        self._selection = selection
        self._selected_at = time.monotonic()
        self._relay_names = None
        self._num_not_relayed = 0
        self._indices_publisher.publish(conversions.indices_to_msg(selection.indices))
        header = Header(stamp=self.get_clock().now().to_msg())
        gains = [b - a for a, b in zip((0.0, *selection.scores), selection.scores, strict=False)]
        self._scores_publisher.publish(
            conversions.named_values_to_msg(header, selection.ranking, gains)
        )
        self.get_logger().info(f'selected {", ".join(selection.names)}: {evidence}')

    # --- upkeep

    def _apply_parameters(self, changed: dict) -> None:
        if changed.keys() & SELECTION_PARAMETERS:
            self._revision += 1
            self._last_error = ''
        if 'max_episodes' in changed:
            self._buffer.max_episodes = changed['max_episodes']
        if 'max_episode_steps' in changed:
            self._assembler.max_episode_steps = changed['max_episode_steps']
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
        self.get_logger().info(f'cleared {response.message}')
        return response

    def _report(self) -> None:
        self._warn_of_drops()
        self._diagnostics_publisher.publish(
            diagnostics.diagnostic_array(
                self.get_clock().now().to_msg(), self._input_status(), self._selection_status()
            )
        )

    def _warn_of_drops(self) -> None:
        now = time.monotonic()
        drops = self._assembler.dropped_messages + self._assembler.dropped_episodes
        if drops == self._warned_drops or now < self._warned_at + _WARNING_PERIOD:
            return
        counts = ', '.join(f'{n} {cause}' for cause, n in (drops - self._warned_drops).items())
        self.get_logger().warning(f'dropped {counts}; the last: {self._assembler.last_drop}')
        self._warned_at, self._warned_drops = now, drops

    def _input_status(self):
        assembler = self._assembler
        silent = time.monotonic() - self._last_state_at > _SILENCE
        recently_warned = time.monotonic() - self._warned_at < 2 * _WARNING_PERIOD
        if silent:
            level, message = diagnostics.WARN, f'no state for {_SILENCE:.0f} s'
        elif recently_warned:
            level, message = diagnostics.WARN, f'dropping; the last: {assembler.last_drop}'
        else:
            level, message = diagnostics.OK, 'collecting'
        values = {
            'episodes': len(self._buffer),
            'steps': self._buffer.num_steps,
            'buffer bytes': self._buffer.nbytes,
            'transitions': assembler.num_transitions,
            'pending messages': assembler.num_pending,
            'episodes cut at max_episode_steps': assembler.num_cut,
            **{f'messages dropped: {k}': n for k, n in assembler.dropped_messages.items()},
            **{f'episodes dropped: {k}': n for k, n in assembler.dropped_episodes.items()},
        }
        return diagnostics.status(f'{self._status_name}: input', level, message, values)

    def _selection_status(self):
        selection = self._selection
        values = {
            'worker': 'computing' if self._queue.busy else 'idle',
            'worker pid': self._queue.worker_pid or 'none',
            'parameters': json.dumps(self._settings),
        }
        if selection is not None:
            values |= {
                'names': ', '.join(selection.names),
                'indices': ', '.join(map(str, selection.indices)),
                'age in s': f'{time.monotonic() - self._selected_at:.0f}',
                'episodes used': selection.episodes,
                'seconds taken': f'{selection.seconds:.2f}',
                'states without a selected channel': self._num_not_relayed,
            }
        if self._last_error:
            level, message = diagnostics.ERROR, self._last_error
        elif selection is None:
            level = diagnostics.OK
            message = (
                f'no selection yet; {len(self._buffer)} episodes of at least '
                f'{self._settings["min_episodes"]}'
            )
        elif self._relay_columns is None and self._relay_names is not None:
            level, message = diagnostics.WARN, 'the newest state lacks a selected channel'
        else:
            level, message = diagnostics.OK, f'selected {values["names"]}'
        return diagnostics.status(f'{self._status_name}: selection', level, message, values)
