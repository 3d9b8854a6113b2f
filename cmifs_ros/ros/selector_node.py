# SPDX-License-Identifier: Apache-2.0

"""The selector node: collects episodes, selects sensors, republishes only those."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
import time
from concurrent.futures import Future

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, Int32MultiArray, String
from std_srvs.srv import Trigger

from cmifs_ros.collect.episodes.buffer import EpisodeBuffer
from cmifs_ros.collect.episodes.file_format import Saved
from cmifs_ros.collect.episodes.reward_check import problem_of_target
from cmifs_ros.collect.episodes.same_actions import with_same_actions
from cmifs_ros.collect.selection_fields import fields_of
from cmifs_ros.collect.selection_report import (
    change,
    evidence,
    headline,
    is_news,
    is_undecided,
    kinds_of_warnings,
)
from cmifs_ros.core import Episode
from cmifs_ros.core.looks import level_of_look
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.words import counted, listed

from . import conversions, diagnostics, selector_status
from .deferred_service import DeferredReplies
from .heard_topics import HeardTopics
from .parameters import declare
from .qos import LATCHED_QOS, STREAM_QOS
from .run_node import run_node
from .selection_in_use import SelectionInUse
from .selection_queue import Job, Outcome, RefusedError, SelectionQueue
from .selector_input import SelectorInput
from .selector_parameters import (
    MEGABYTE,
    PARAMETERS,
    SELECTION_PARAMETERS,
    check_parameters,
    selector_settings,
)
from .selector_storage import SelectorStorage
from .state_relay import StateRelay

#: Seconds between looks at the worker.
_POLL_PERIOD = 0.1
#: Seconds that an answer given at the end has to arrive.
_LAST_ANSWER = 0.5
#: Seconds between two lines of how many episodes there are.
_PROGRESS_PERIOD = 10.0

NOTHING_SO_FAR = diagnostics.OK, ''
CLEARED_MEANWHILE = 'the selection is not used: its episodes were cleared meanwhile'


class SelectorNode(Node):
    """Publish the sensors that the return depends on, and the state reduced to them."""

    def __init__(self):
        super().__init__('selector')
        self._input: SelectorInput | None = None
        self._settings = declare(self, PARAMETERS, self._check, self._apply_parameters)
        max_bytes = self._settings['max_buffer_mb'] * MEGABYTE
        self._buffer = EpisodeBuffer(self._max_episodes, max_bytes)
        self._queue = SelectionQueue(
            self._make_job,
            lambda: self._revision,
            self._on_outcome,
            self._settings['selection_timeout'],
        )
        self._revision = 0  # counts what would change a selection
        self._attempted_revision: int | None = 0  # None: the last attempt failed
        self._generation = 0  # counts how often the episodes were thrown away
        self._num_seen = 0  # episodes of the task as it is, also those that left the buffer
        self._in_use: SelectionInUse | None = None
        self._number = 0  # of the newest selection that was used
        self._attempt = NOTHING_SO_FAR  # level and message of the last one, if it gave nothing
        self._warned: set[str] = set()  # Kinds of warnings.
        self._counted_at, self._counted = -math.inf, 0
        self._storage: SelectorStorage | None = None

        self._indices_publisher = self.create_publisher(
            Int32MultiArray, 'selected_indices', LATCHED_QOS
        )
        self._scores_publisher = self.create_publisher(JointState, 'scores', LATCHED_QOS)
        self._selection_publisher = self.create_publisher(String, 'selection', LATCHED_QOS)
        self._relay = StateRelay(self, self._settings)
        self._topics = HeardTopics(self)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._input = SelectorInput(
            self,
            self._settings,
            self._buffer,
            on_state=self._relay.relay,
            on_episode=self._keep,
            on_channels=self._on_new_channels,
            on_restart=self._restart,
        )
        # The usual depth of 10 would lose calls that come in a burst.
        service = self.create_service(
            Trigger, 'select_features', self._on_select_features, qos_profile=STREAM_QOS
        )
        self._replies = DeferredReplies(self, service)
        self.create_service(Trigger, '~/clear_episodes', self._on_clear_episodes)
        self.create_service(Trigger, '~/cancel', self._on_cancel)
        # Steady time: a simulated clock that stands still must not stop the node.
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_POLL_PERIOD, self._queue.poll, clock=self._steady_clock)
        self.create_timer(1.0, self._report, clock=self._steady_clock)
        self._selection_timer = None
        self._set_selection_period(self._settings['selection_period'])
        if self._settings['episodes_path']:
            self._storage = SelectorStorage(self, self._settings['episodes_path'])
            self._restore()
        self._queue.start()
        self.get_logger().info(f'waiting for {" and ".join(self._input.topics)}')

    def destroy_node(self) -> None:
        """End the worker process and the last save, answer who waits, then end the node."""
        has_answered = self._queue.stop()
        has_answered |= self._replies.flush()
        if self._storage is not None:
            self._storage.stop()
        if has_answered:  # What a client has not read yet is lost with this process.
            time.sleep(_LAST_ANSWER)
        super().destroy_node()

    @property
    def _max_episodes(self) -> int:
        return max(self._settings['max_episodes'], self._settings['min_episodes'])

    @property
    def _channel_names(self) -> tuple[str, ...] | None:
        return None if self._input is None else self._input.assembler.channel_names

    @property
    def _action_names(self) -> tuple[str, ...]:
        return self._input.assembler.actions.names

    # --- episodes and states

    def _keep(self, episode: Episode) -> None:
        if not self._buffer.append(episode):
            return
        self._revision += 1
        self._num_seen += 1
        if self._in_use is not None:
            self._in_use.add(episode)
        names = self._channel_names, self._action_names
        if self._storage is not None and not self._storage.append(episode, *names):
            self._save()

    def _on_new_channels(self) -> None:
        """Keep the selection, also in another order of the channels, if these have all of it."""
        names = self._channel_names
        if self._in_use is not None:
            selection = self._in_use.selection
            missing = set(selection.names) - set(names)
            if missing:
                self.get_logger().warning(
                    f'the selection is dropped: {listed(sorted(missing))} is not among the new '
                    f'channels {listed(names)}'
                )
                self._in_use = None
                self._relay.use(None)
            elif names != self._in_use.channel_names:
                indices = tuple(map(names.index, selection.names))
                moved = dataclasses.replace(
                    selection, indices=indices, means=(), spreads=(), number=self._number + 1
                )
                self._use(moved, self._in_use.selected_at, self._in_use.cause)
        try:
            check_parameters(self._settings, names)
        except ValueError as error:
            self._attempt = diagnostics.ERROR, str(error)
            self.get_logger().error(str(error))
        self._save()  # Now episodes with these channels can be appended.

    def _restart(self) -> None:
        self.get_logger().warning(
            'the states come with other channels (restart_on_new_channels): '
            f'{counted(len(self._buffer), "episode")} forgotten'
        )
        self._clear()

    def _on_clear_episodes(self, request, response):
        response.success = True
        response.message = json.dumps({'episodes': len(self._buffer)})
        self._clear()
        self.get_logger().info(f'cleared {response.message}')
        return response

    def _clear(self) -> None:
        self._buffer.clear()
        self._num_seen = 0
        self._input.assembler.clear()
        self._revision += 1
        self._generation += 1
        self._attempt = NOTHING_SO_FAR
        if self._in_use is not None:
            self._in_use.forget_data()
        self._save()

    # --- selections

    def _on_select_features(self, request, response) -> Future:
        answer = Future()

        def on_outcome(outcome: Outcome) -> None:
            response.success = not outcome.error
            response.message = json.dumps(self._reply(outcome))
            answer.set_result(response)

        self._queue.request('service call', on_outcome)
        return answer

    def _on_cancel(self, request, response):
        response.success = self._queue.cancel()
        response.message = 'cancelled' if response.success else 'no selection was under way'
        self.get_logger().info(response.message)
        return response

    def _reply(self, outcome: Outcome) -> dict:
        if outcome.selection is None:
            counts = {'episodes': len(self._buffer), 'min_episodes': self._settings['min_episodes']}
            return {'error': outcome.error} | counts
        reply = fields_of(outcome.selection, self._topics.of(outcome.selection))
        return reply | {'error': outcome.error} if outcome.error else reply

    def _make_job(self, cause: str) -> Job:
        self._attempted_revision = self._revision
        values, names = self._settings, self._channel_names
        if len(self._buffer) < values['min_episodes']:
            problem = self._input.problem
            raise RefusedError(
                f'{counted(len(self._buffer), "episode")} so far; a selection needs at least '
                f'{values["min_episodes"]} (min_episodes)' + (f'; {problem}' if problem else '')
            )
        try:
            check_parameters(values, names)
            target = self._input.target
            settings = selector_settings(values, names, self._input.gamma(), target)
        except ValueError as error:
            raise RefusedError(str(error)) from None
        if 'significance' in settings:
            settings['significance'] = level_of_look(
                settings['significance'],
                self._num_seen,
                num_first=values['min_episodes'],
                buffer_size=values['max_episodes'],
            )
        held = self._buffer.snapshot()
        episodes, note = with_same_actions(held, values['min_episodes'])
        if note:
            self.get_logger().warning(note, throttle_duration_sec=300.0)
        problem = '' if values['method'] == 'kdr' else problem_of_target(episodes, target)
        if problem:
            self._attempt = diagnostics.WARN, problem
            self.get_logger().warning(f'no selection: {problem}', throttle_duration_sec=300.0)
            raise RefusedError(problem)
        in_use = self._in_use.confirmed if self._in_use is not None else ()
        least_kept = values['min_episodes'] if values['forget_outdated'] else None
        options = {'start': in_use, 'least_kept': least_kept}
        options['action_names'] = self._action_names if episodes[0].actions.size else ()
        arguments = (episodes, names, values['method'], settings, options)
        # Episodes without their actions are copies of those held.
        held = held if len(held) == len(episodes) else episodes
        return Job(self._revision, self._generation, cause, arguments, held)

    def _select_periodically(self) -> None:
        enough = len(self._buffer) >= self._settings['min_episodes']
        if enough and not self._queue.busy and self._revision != self._attempted_revision:
            self._queue.request('timer', lambda outcome: None)

    def _on_outcome(self, outcome: Outcome) -> Outcome:
        selection, job = outcome.selection, outcome.job
        if job is None:  # Whoever asked is told why; nothing is wrong.
            return outcome
        if job.generation != self._generation:
            self.get_logger().info(CLEARED_MEANWHILE)
            return dataclasses.replace(outcome, error=outcome.error or CLEARED_MEANWHILE)
        if selection is None:
            self._attempt = diagnostics.ERROR, outcome.error
            self._attempted_revision = None
            self.get_logger().warning(f'no selection: {outcome.error}')
            return outcome
        if selection.outdated:
            self.get_logger().info(change(selection))
            self._buffer.forget(job.held[: selection.outdated])
            self._num_seen = len(self._buffer)
            self._save()
        self._log_warnings(selection)
        if not selection.indices:
            level = diagnostics.OK if is_undecided(selection) else diagnostics.WARN
            self._attempt = level, headline(selection)
            self.get_logger().info(f'{headline(selection)}: {evidence(selection)}')
            return outcome
        previous = self._in_use.selection if self._in_use is not None else None
        if is_news(selection, previous):
            self.get_logger().info(f'{headline(selection)}: {evidence(selection)}')
        selection = dataclasses.replace(selection, number=self._number + 1)
        self._use(selection, time.monotonic(), job.cause)
        self._save()
        return dataclasses.replace(outcome, selection=selection)

    def _log_warnings(self, selection: Selection) -> None:
        """Log what limits what the data show, each kind once."""
        warnings = kinds_of_warnings(selection.warnings)
        for kind in warnings.keys() - self._warned:
            self.get_logger().warning(warnings[kind])
        self._warned |= warnings.keys()

    def _use(self, selection: Selection, selected_at: float, cause: str) -> None:
        self._number = selection.number
        self._attempt = NOTHING_SO_FAR
        self._in_use = SelectionInUse(
            selection,
            self._channel_names,
            selected_at=selected_at,
            cause=cause,
            horizon=self._settings['min_episodes'],
        )
        self._relay.use(self._in_use)
        self._publish_selection()
        self._indices_publisher.publish(conversions.indices_to_msg(selection.indices))
        header = Header(stamp=self.get_clock().now().to_msg())
        self._scores_publisher.publish(
            conversions.named_values_to_msg(header, selection.ranking, selection.scores)
        )

    def _publish_selection(self) -> None:
        selection = self._in_use.selection
        fields = fields_of(selection, self._topics.of(selection))
        self._selection_publisher.publish(String(data=json.dumps(fields)))

    def _tell_doubt(self) -> None:
        """Publish the selection again when something speaks against it, or nothing does again."""
        if self._in_use is None:
            return
        doubt = self._in_use.doubt(self._attempt[1])
        if doubt != self._in_use.selection.doubt:
            self._in_use.selection = dataclasses.replace(self._in_use.selection, doubt=doubt)
            self._publish_selection()

    # --- storage

    def _restore(self) -> None:
        saved = self._storage.restore(self._buffer.max_episodes, self._buffer.max_bytes)
        if saved is None:
            return
        for episode in saved.episodes:
            self._buffer.append(episode)
        self._num_seen = len(self._buffer)
        self._input.assembler.channel_names = saved.channel_names
        self._input.assembler.actions.names = saved.action_names
        self._revision += 1
        if saved.selection is not None:
            age = max(0.0, time.time() - saved.selected_at)
            # One that `select_from_bag` has written was never in use.
            selection = dataclasses.replace(saved.selection, number=saved.selection.number or 1)
            self._use(selection, time.monotonic() - age, 'read from the file')
        self._save()

    def _save(self) -> None:
        if self._storage is not None:
            selection = self._in_use.selection if self._in_use is not None else None
            selected_at = time.time() - self._in_use.age if self._in_use is not None else 0.0
            self._storage.save(
                Saved(
                    self._channel_names,
                    self._buffer.snapshot(),
                    selection,
                    selected_at,
                    action_names=self._action_names,
                )
            )

    # --- upkeep

    def _check(self, values: dict) -> None:
        check_parameters(values, self._channel_names)

    def _apply_parameters(self, changed: dict) -> None:
        if changed.keys() & SELECTION_PARAMETERS:
            self._revision += 1
            self._attempt = NOTHING_SO_FAR
        if {'min_episodes', 'max_episodes'} & changed.keys():
            self._buffer.max_episodes = self._max_episodes
        if 'max_buffer_mb' in changed:
            self._buffer.max_bytes = changed['max_buffer_mb'] * MEGABYTE
        if 'layout' in changed:
            self._relay.use(self._in_use)
        self._input.apply()
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

    def _report(self) -> None:
        self._log_count()
        self._tell_doubt()
        statuses = [self._input.report(), self._selection_status()]
        if self._storage is not None:
            statuses.append(self._storage.report(self._status_name('storage')))
        self._diagnostics_publisher.publish(
            diagnostics.diagnostic_array(self.get_clock().now().to_msg(), *statuses)
        )

    def _log_count(self) -> None:
        now, count, needed = time.monotonic(), len(self._buffer), self._settings['min_episodes']
        if (
            self._in_use is None
            and count > self._counted < needed
            and (now > self._counted_at + _PROGRESS_PERIOD or count >= needed)
        ):
            self.get_logger().info(f'{min(count, needed)} of {counted(needed, "episode")}')
            self._counted_at, self._counted = now, count

    def _status_name(self, what: str) -> str:
        return f'{self.get_fully_qualified_name().lstrip("/")}: {what}'

    def _selection_status(self):
        attempt = self._attempt
        if self._in_use is None and attempt == NOTHING_SO_FAR:
            attempt = diagnostics.OK, self._waiting_for()
        return selector_status.selection(
            self._status_name('selection'),
            self._in_use,
            relay=self._relay,
            queue=self._queue,
            attempt=attempt,
            settings=self._settings,
        )

    def _waiting_for(self) -> str:
        count, needed = len(self._buffer), self._settings['min_episodes']
        if count < needed:
            return f'no selection yet; {counted(count, "episode")} of at least {needed}'
        if self._selection_timer is None:
            what = f'no selection yet; {counted(count, "episode")}, which is enough'
            return f'{what}: call select_features, as selection_period is 0'
        return f'no selection yet; the next one is from {counted(count, "episode")}'


if __name__ == '__main__':
    sys.exit(run_node('selector_node', 'SelectorNode'))
