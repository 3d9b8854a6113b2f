# SPDX-License-Identifier: Apache-2.0

"""A live view of a selector in the terminal: its input, its selection, and the evidence."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.exceptions import InvalidNamespaceException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_namespace import validate_namespace
from rich.console import Console
from rich.live import Live
from std_msgs.msg import String

from cmifs_ros.collect.advice import advice_of
from cmifs_ros.collect.robot_file.own_topics import is_own_entry
from cmifs_ros.collect.selection_fields import selection_of
from cmifs_ros.ros.heard_topics import HeardTopics
from cmifs_ros.ros.qos import LATCHED_QOS
from cmifs_ros.ros.run_node import end_in_any_case

from .arguments import folder_to_write
from .program import CommandError
from .watch_view import Snapshot, Status, view

#: What the statuses of a selector are about.
_OF_SELECTOR = ('input', 'selection', 'storage')
#: Nodes that publish once a second have done so by then.
_ROUND = 1.5
_REFRESH_PERIOD = 0.25
#: Seconds to wait for a selector if the output is not a terminal.
_PATIENCE = 10.0
_MAX_ELSEWHERE = 10
_MAX_TOPICS = 100


class Watcher:
    """Listen to the first selector heard in a namespace, and to its sampler."""

    def __init__(self, node):
        self._node = node
        self._namespace = node.get_namespace().strip('/')
        self._heard_at = self._heard_sampler_at = time.monotonic()
        self.snapshot = Snapshot()
        self._topics = HeardTopics(node)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        node.create_subscription(String, 'selection', self._on_selection, LATCHED_QOS)

    @property
    def is_complete(self) -> bool:
        """Whether the selector has been heard, and the sampler if there is one."""
        if not self.snapshot.is_complete or 'sampler' not in self._node.get_node_names():
            return self.snapshot.is_complete
        selection = self.snapshot.selection
        has_topics = selection is None or self._topics.of(selection) is not None
        return bool(self.snapshot.sampler) and has_topics

    def look(self) -> Snapshot:
        """Return what is known now."""
        now = time.monotonic()
        self.snapshot.silence = now - self._heard_at
        self.snapshot.sampler_silence = now - self._heard_sampler_at
        selection = self.snapshot.selection
        topics = None if selection is None else self._topics.of(selection)
        self.snapshot.advice = None if topics is None else advice_of(selection, *topics)
        return self.snapshot

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            node, _, what = status.name.rpartition(': ')
            if not is_own_entry(status) or not node:
                continue
            namespace = node.rpartition('/')[0]
            said = Status(
                ord(status.level), status.message, {v.key: v.value for v in status.values}
            )
            if what not in _OF_SELECTOR:
                if namespace == self._namespace:
                    self._on_sampler(what, said)
            elif namespace != self._namespace:
                known = {*self.snapshot.elsewhere, f'/{namespace}'}
                self.snapshot.elsewhere = sorted(known)[:_MAX_ELSEWHERE]
            elif self.snapshot.selector in ('', node):
                self._heard_at = time.monotonic()
                self.snapshot.selector = node
                self.snapshot.statuses[what] = said

    def _on_sampler(self, what: str, said: Status) -> None:
        self._heard_sampler_at = time.monotonic()
        if what in self.snapshot.sampler or len(self.snapshot.sampler) < _MAX_TOPICS:
            self.snapshot.sampler[what] = said

    def _on_selection(self, msg: String) -> None:
        try:
            self.snapshot.selection = selection_of(json.loads(msg.data))
            self.snapshot.unreadable = ''
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError) as error:
            # The publisher may be another node, or a selector of another version.
            self.snapshot.unreadable = repr(error)


def run(node: Node, console: Console, report: Path | None) -> int:
    """Show the view until a signal arrives; once if not in a terminal. Return the exit code.

    With a folder for a report, write the report instead.
    """
    stopping = 0

    def stop(number, _):
        nonlocal stopping
        stopping = number

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    watcher = Watcher(node)
    if report is not None or not console.is_terminal:
        begin = now = incomplete_at = time.monotonic()
        # One more round, because the sampler may be heard after the selector.
        while not stopping and now < incomplete_at + _ROUND:
            rclpy.spin_once(node, timeout_sec=_REFRESH_PERIOD)
            now = time.monotonic()
            if not watcher.is_complete and now < begin + _PATIENCE:
                incomplete_at = now
        if report is not None:
            if stopping:
                raise CommandError('interrupted; nothing is written')
            _write_report(watcher.look(), report)
            return 0
        with console.capture() as captured:  # Rich would end the process where nobody reads.
            console.print(view(watcher.look(), console))
        print(captured.get(), end='', flush=True)
        return 0 if watcher.snapshot.selector or watcher.snapshot.sampler else 1
    with Live(console=console, auto_refresh=False, screen=True) as live:
        shown_at = 0.0
        while not stopping:
            rclpy.spin_once(node, timeout_sec=_REFRESH_PERIOD)
            if time.monotonic() >= shown_at + _REFRESH_PERIOD:
                shown_at = time.monotonic()
                live.update(view(watcher.look(), console, console.height), refresh=True)
    # The screen is restored; print the last view below.
    console.print(view(watcher.look(), console))
    return 0


def _write_report(snapshot: Snapshot, folder: Path) -> None:
    """Write the page of `select_from_bag --report`, except for what needs the episodes."""
    from .html_report import write_report

    if snapshot.selection is None:
        status = snapshot.statuses.get('selection')
        raise CommandError(
            snapshot.unreadable or (status.message if status else 'no selector heard')
        )
    path = write_report(
        folder, snapshot.selection, dropped=snapshot.dropped, advice=snapshot.advice
    )
    print(f'written: {path}')


def main(arguments: list[str] | None = None, program: str = 'watch') -> int:
    """Watch; return the exit code."""
    parser = argparse.ArgumentParser(
        program,
        description=f'{__doc__} Ctrl-C ends it. Without a terminal, it is printed once.',
        allow_abbrev=False,
    )
    parser.add_argument('--namespace', default='/', help='namespace of the selector (default /)')
    parser.add_argument(
        '--report',
        type=folder_to_write,
        metavar='FOLDER',
        help='instead, write a report about the selection in use, FOLDER/index.html',
    )
    options = parser.parse_args(arguments)
    namespace = '/' + options.namespace.strip('/')
    try:
        validate_namespace(namespace)
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node(f'watch_{os.getpid()}', namespace=namespace)
        code = run(node, Console(), options.report)
        end_in_any_case()
        # At the end of the process, it would take seconds on a busy machine.
        node.destroy_node()
        return code
    except InvalidNamespaceException:
        print(
            f'{program}: --namespace is {options.namespace!r}; expected a name such as /robot1',
            file=sys.stderr,
        )
        return 2
    except BrokenPipeError:
        raise
    except (CommandError, OSError) as error:
        print(f'{program}: {error}', file=sys.stderr)
        return 1
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    finally:
        rclpy.try_shutdown()


if __name__ == '__main__':
    sys.exit(main())
