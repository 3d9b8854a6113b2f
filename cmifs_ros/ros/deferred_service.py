# SPDX-License-Identifier: Apache-2.0

"""Services whose reply takes its time, and which many clients call at once."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.service import Service

#: Every client of a service receives the replies to all of them, and keeps the newest 10 that it
#: has not looked at yet. Replies that came faster would push out that to a client which the system
#: lets wait: at this pace it may take half a second.
_AT_ONCE, _PERIOD = 2, 0.1
#: Replies that may wait for their turn; further ones are sent at once.
_MAX_WAITING = 1000


class DeferredReplies:
    """Let the callback of a service return a future response, and send no reply too soon.

    An `async` callback could wait for the response too, but the `EventsExecutor` of rclpy before
    7.1.11 cannot run one, and `SingleThreadedExecutor` resumes each that waits at every message.

    Parameters
    ----------
    node : rclpy.node.Node
    service : rclpy.service.Service
        One of the node's, whose callback returns futures.

    """

    def __init__(self, node: Node, service: Service):
        self._send_now = service.send_response
        service.send_response = self._send
        self._waiting: deque[Callable[[], None]] = deque()
        self._allowed = _AT_ONCE
        # Steady time: a simulated clock that stands still must not stop it.
        node.create_timer(_PERIOD, self._go_on, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def flush(self) -> bool:
        """Send all that waits, as the node ends; return whether anything did."""
        has_waited = bool(self._waiting)
        while self._waiting:
            self._waiting.popleft()()
        return has_waited

    def _send(self, response: Future, header) -> None:
        response.add_done_callback(lambda done: self._reply(done.result(), header))

    def _reply(self, response, header) -> None:
        self._waiting.append(lambda: self._send_now(response, header))
        if len(self._waiting) > _MAX_WAITING:
            self._waiting.popleft()()
        self._send_allowed()

    def _go_on(self) -> None:
        self._allowed = _AT_ONCE
        self._send_allowed()

    def _send_allowed(self) -> None:
        while self._waiting and self._allowed:
            self._allowed -= 1
            self._waiting.popleft()()
