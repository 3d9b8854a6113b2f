"""The life of a node's process: start, spin, end cleanly."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from .parameters import BadParameterError

#: How soon a signal is noticed, in seconds.
_SIGNAL_PERIOD = 0.1


def run_node(make_node: Callable[[], Node]) -> int:
    """Run a node until SIGINT, SIGTERM or shutdown; return the process's exit code.

    The code is 0, or 2 if the node cannot start as it was asked to.

    The signals end the loop between two callbacks. rclpy's own handlers would shut the
    context down in the middle of one, and its next publish would raise.

    The node may have a method `close`, called before it is destroyed.
    """
    stopping = False

    def stop(*_):
        nonlocal stopping
        stopping = True

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    node = None
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # A ROS argument or a parameter file cannot be read.
        print(error, file=sys.stderr)
        return 2
    try:
        node = make_node()
        # The executor returns after each callback, so this also bounds the wait for one.
        node.create_timer(
            _SIGNAL_PERIOD, lambda: None, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not stopping:
            executor.spin_once()
    except ExternalShutdownException:
        pass
    except BadParameterError as error:
        print(error, file=sys.stderr)
        return 2
    finally:
        if node is not None:
            node.close()
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
