# SPDX-License-Identifier: Apache-2.0

"""A node's process: start, spin, clean shutdown."""

from __future__ import annotations

import gc
import importlib
import os
import signal
import sys

#: Seconds until a signal is noticed, at most.
_SIGNAL_PERIOD = 0.1
#: Seconds until a process ends whose middleware hangs.
_LAST_SECONDS = 5


def selector_node() -> int:
    """Run the selector; see `run_node`."""
    return run_node('selector_node', 'SelectorNode')


def sampler_node() -> int:
    """Run the sampler; see `run_node`."""
    return run_node('sampler_node', 'SamplerNode')


def simulator_node() -> int:
    """Run the simulator; see `run_node`."""
    return run_node('simulator_node', 'SimulatorNode')


def run_node(program: str, name: str) -> int:
    """Run a node of this package until SIGINT, SIGTERM or shutdown; return the exit code.

    It is 0, or 2 if the arguments or parameters are invalid; a node that cannot continue raises
    SystemExit with a message. A signal ends the loop between two callbacks: rclpy's own handlers
    would shut the context down during a callback, whose next publish would raise. While the node
    is being loaded, a signal ends the process at once.
    """
    _on_signals(lambda *_: os._exit(0))
    import rclpy
    from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
    from rclpy.executors import ExternalShutdownException
    from rclpy.signals import SignalHandlerOptions

    stopping = False

    def stop(*_):
        nonlocal stopping
        stopping = True

    from .node_arguments import check_arguments

    module = importlib.import_module(f'.{program}', __package__)
    make_node = getattr(module, name)
    _on_signals(stop)
    try:
        check_arguments(program, module.__doc__ or '', module.PARAMETERS)
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # A ROS argument or a parameter file is invalid.
        print(error, file=sys.stderr)
        return 2
    node = None
    try:
        node = make_node()
        executor = make_executor()
        executor.add_node(node)
        # Loaded modules stay: searching them for garbage takes 30 ms each time.
        gc.collect()
        gc.freeze()
        while not stopping:
            executor.spin_once(_SIGNAL_PERIOD)
    except ExternalShutdownException:
        pass
    except (ValueError, InvalidParameterTypeException, InvalidParameterValueException) as error:
        if node is not None:
            raise
        print(error, file=sys.stderr)
        return 2
    finally:
        end_in_any_case()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def end_in_any_case() -> None:
    """Let the system end this process in some seconds, unless it has ended by then.

    A process that is killed may leave a mutex in the shared memory of Fast DDS 2.14 locked. Others
    that destroy a publisher then wait for it for ever, with the interpreter lock held.
    """
    signal.alarm(_LAST_SECONDS)


def make_executor(context=None):
    """Return the executor with the lowest cost; docs/reliability.md has the comparison.

    Spin it with a timeout: without one the `EventsExecutor` of rclpy 7.1.6 waits while it holds
    the interpreter lock. rclpy has it since 7.1.4.
    """
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        from rclpy.executors import SingleThreadedExecutor

        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


def _on_signals(handler) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)
