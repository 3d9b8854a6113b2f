"""Services whose reply takes its time."""

from __future__ import annotations

from concurrent.futures import Future

from rclpy.service import Service


def answer_later(service: Service) -> None:
    """Let the callback of a service return a future response; it is sent once it is there.

    An `async` callback would do the same, but the `EventsExecutor` of rclpy before 7.1.11 cannot
    run one, and `SingleThreadedExecutor` resumes each that waits at every message.
    """
    send_now = service.send_response

    def send(response: Future, header) -> None:
        response.add_done_callback(lambda done: send_now(done.result(), header))

    service.send_response = send
