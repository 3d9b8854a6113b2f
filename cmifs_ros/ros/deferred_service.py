# SPDX-License-Identifier: Apache-2.0

"""Services that reply later, to many clients at once."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.service import Service

#: Seconds between replies. Each client of a service receives the replies to all clients and queues
#: the newest 10. Faster replies would push out the one meant for a client that is slow to read: at
#: this pace it may take a second.
_PERIOD = 0.1
#: Replies that may be queued; further ones are sent at once.
_MAX_WAITING = 1000


class DeferredReplies:
    """Let a service callback return a future of its response; space out the replies.

    An `async` callback could wait for the response too, but the `EventsExecutor` of rclpy before
    7.1.11 cannot run one, and `SingleThreadedExecutor` resumes all waiting ones at every message.

    Parameters
    ----------
    node : rclpy.node.Node
    service : rclpy.service.Service
        A service of the node whose callback returns futures.

    """

    def __init__(self, node: Node, service: Service):
        self._send_now = service.send_response
        service.send_response = self._send
        self._waiting: deque[Callable[[], None]] = deque()
        self._is_allowed = True
        # Steady time: a paused simulation must not stop it.
        node.create_timer(_PERIOD, self._go_on, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def flush(self) -> bool:
        """Send all queued replies because the node ends; return whether there were any."""
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
        self._is_allowed = True
        self._send_allowed()

    def _send_allowed(self) -> None:
        if self._waiting and self._is_allowed:
            self._is_allowed = False
            self._waiting.popleft()()
