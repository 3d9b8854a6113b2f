# SPDX-License-Identifier: Apache-2.0

"""The selector node: collects episodes, selects sensors, republishes only those."""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from concurrent.futures import Future

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from std_srvs.srv import Trigger

from cmifs_ros.collect.episodes.buffer import EpisodeBuffer
from cmifs_ros.collect.selection_report import (
    change,
    evidence,
    headline,
    is_news,
    is_undecided,
    kinds_of_warnings,
)
from cmifs_ros.core import Episode
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.words import counted

from . import diagnostics, selector_status
from .deferred_service import DeferredReplies
from .parameters import declare
from .qos import STREAM_QOS
from .run_node import run_node
from .selection_queue import Job, Outcome, SelectionQueue
from .selection_request import UnusableDataError, make_job
from .selector_input import SelectorInput
from .selector_output import SelectorOutput
from .selector_parameters import MEGABYTE, PARAMETERS, SELECTION_PARAMETERS, check_parameters
from .selector_storage import SelectorStorage

#: Seconds between checks of the worker.
_POLL_PERIOD = 0.1
#: Seconds that the last answers have to arrive before the process ends.
_LAST_ANSWER = 0.5

NOTHING_SO_FAR = diagnostics.OK, ''
CLEARED_MEANWHILE = 'the selection is discarded: its episodes were cleared meanwhile'


class SelectorNode(Node):
    """Publish the sensors that the return depends on, and a state of only these."""

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
        self._revision = 0  # counts changes of data or settings
        self._attempted_revision: int | None = 0  # None: the last attempt failed
        self._attempt = NOTHING_SO_FAR  # level and message, if the last one failed
        self._warned: set[str] = set()  # Kinds of warnings.
        self._storage: SelectorStorage | None = None

        self._output = SelectorOutput(self, self._settings)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._input = SelectorInput(
            self,
            self._settings,
            self._buffer,
            on_state=self._output.relay.relay,
            on_publishers=self._output.relay.forget_publishers,
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
        # Steady time: a paused simulation must not stop the node.
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_POLL_PERIOD, self._queue.poll, clock=self._steady_clock)
        self.create_timer(1.0, self._report, clock=self._steady_clock)
        self._selection_timer = None
        self._set_selection_period(self._settings['selection_period'])
        if self._settings['episodes_path']:
            self._storage = SelectorStorage(
                self, self._settings['episodes_path'], self._buffer, self._input, self._output
            )
            if self._storage.restore():
                self._revision += 1
        self._queue.start()
        self.get_logger().info(f'waiting for {" and ".join(self._input.topics)}')

    def destroy_node(self) -> None:
        """Stop the worker, answer waiting calls, finish saving, then end the node."""
        has_answered = self._queue.stop()
        has_answered |= self._replies.flush()
        if self._storage is not None:
            self._storage.stop()
        if has_answered:  # An answer that a client has not read is lost with this process.
            time.sleep(_LAST_ANSWER)
        super().destroy_node()

    @property
    def _max_episodes(self) -> int:
        return max(self._settings['max_episodes'], self._settings['min_episodes'])

    # --- episodes and states

    def _keep(self, episode: Episode) -> None:
        if not self._buffer.append(episode):
            return
        self._revision += 1
        if self._output.in_use is not None:
            self._output.in_use.add(episode)
        if self._storage is not None:
            self._storage.append(episode)

    def _on_new_channels(self) -> None:
        names = self._input.channel_names
        self._output.change_channels(names)
        try:
            check_parameters(self._settings, names)
        except ValueError as error:
            self._attempt = diagnostics.ERROR, str(error)
            self.get_logger().error(str(error))
        self._save()  # Now episodes with these channels can be appended.

    def _restart(self) -> None:
        self.get_logger().warning(
            'the states have other channels now (restart_on_new_channels): '
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
        self._input.assembler.clear()
        self._revision += 1
        self._attempt = NOTHING_SO_FAR
        if self._output.in_use is not None:
            self._output.in_use.forget_data()
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
        response.message = 'cancelled' if response.success else 'no selection was running'
        self.get_logger().info(response.message)
        return response

    def _reply(self, outcome: Outcome) -> dict:
        if outcome.selection is None:
            counts = {'episodes': len(self._buffer), 'min_episodes': self._settings['min_episodes']}
            return {'error': outcome.error} | counts
        reply = self._output.fields(outcome.selection)
        return reply | {'error': outcome.error} if outcome.error else reply

    def _make_job(self, cause: str) -> Job:
        self._attempted_revision = self._revision
        try:
            job = make_job(
                self._revision,
                cause,
                buffer=self._buffer,
                source=self._input,
                settings=self._settings,
                in_use=self._output.in_use,
                losses=self._output.topics.losses or self._input.assembler.builder.ends.problem(),
            )
        except UnusableDataError as error:
            self._attempt = diagnostics.WARN, str(error)
            self.get_logger().warning(f'no selection: {error}', throttle_duration_sec=300.0)
            raise
        if job.note:
            self.get_logger().warning(job.note, throttle_duration_sec=300.0)
        return job

    def _select_periodically(self) -> None:
        enough = len(self._buffer) >= self._settings['min_episodes']
        if enough and not self._queue.busy and self._revision != self._attempted_revision:
            self._queue.request('timer', lambda outcome: None)

    def _on_outcome(self, outcome: Outcome) -> Outcome:
        selection, job = outcome.selection, outcome.job
        if job is None:  # Refused or cancelled; the caller gets the reason.
            return outcome
        if job.num_clears != self._buffer.num_clears:
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
            self._save()
        self._log_warnings(selection)
        if not selection.indices:
            level = diagnostics.OK if is_undecided(selection) else diagnostics.WARN
            self._attempt = level, headline(selection)
            self.get_logger().info(f'{headline(selection)}: {evidence(selection)}')
            return outcome
        in_use = self._output.in_use
        if is_news(selection, None if in_use is None else in_use.selection):
            self.get_logger().info(f'{headline(selection)}: {evidence(selection)}')
        self._attempt = NOTHING_SO_FAR
        selection = self._output.use(selection, self._input.channel_names, job.cause)
        self._save()
        return dataclasses.replace(outcome, selection=selection)

    def _log_warnings(self, selection: Selection) -> None:
        """Log warnings about the data, each kind once."""
        warnings = kinds_of_warnings(selection.warnings)
        for kind in warnings.keys() - self._warned:
            self.get_logger().warning(warnings[kind])
        self._warned |= warnings.keys()

    # --- upkeep

    def _save(self) -> None:
        if self._storage is not None:
            self._storage.save()

    def _check(self, values: dict) -> None:
        check_parameters(values, None if self._input is None else self._input.channel_names)

    def _apply_parameters(self, changed: dict) -> None:
        if changed.keys() & SELECTION_PARAMETERS:
            self._revision += 1
            self._attempt = NOTHING_SO_FAR
        if {'min_episodes', 'max_episodes'} & changed.keys():
            self._buffer.max_episodes = self._max_episodes
        if 'max_buffer_mb' in changed:
            self._buffer.max_bytes = changed['max_buffer_mb'] * MEGABYTE
        if 'layout' in changed:
            self._output.apply()
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
        self._output.update(self._attempt[1])
        statuses = [self._input.report(), self._selection_status()]
        if self._storage is not None:
            statuses.append(self._storage.report())
        self._diagnostics_publisher.publish(
            diagnostics.diagnostic_array(self.get_clock().now().to_msg(), *statuses)
        )

    def _selection_status(self):
        return selector_status.selection(
            f'{diagnostics.name_of(self)}: selection',
            self._output,
            queue=self._queue,
            attempt=self._attempt,
            num_episodes=len(self._buffer),
            settings=self._settings,
        )


if __name__ == '__main__':
    sys.exit(run_node('selector_node', 'SelectorNode'))
