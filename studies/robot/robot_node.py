# SPDX-License-Identifier: Apache-2.0

"""The robot's process: publish its sensors for a number of goals, then rest and end.

Like a simulator, it computes a step at once and then waits for the next one. It waits just after
sending messages without a stamp, so that others have a full step to receive them.
"""

from __future__ import annotations

import signal
import sys
import time

import rclpy
from rclpy.signals import SignalHandlerOptions

from .drive import BETWEEN, STEP, TICK, TOPICS, Sensors

#: Start of the robot's time in ticks: a stamp of 0 means none.
_FIRST_TICK = 100_000
#: Subscriptions of each topic that are waited for: the sampler's and the recorder's; of the clock
#: another one of the sampler, and the selector's.
_LISTENERS = dict.fromkeys(TOPICS, 2) | {'/clock': 4}
#: Ticks after the last goal, for messages in transit.
_LAST_TICKS = 100


def main() -> None:
    """Run: `robot_node GOALS SEED SPEED`."""
    num_goals, seed, speed = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    stopping = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopping.append(True))
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('robot')
    publishers = {t: node.create_publisher(kind, t, qos) for t, (kind, qos) in TOPICS.items()}
    while not stopping and any(
        publishers[topic].get_subscription_count() < count for topic, count in _LISTENERS.items()
    ):
        time.sleep(0.1)
    sensors, tick, last = Sensors(seed), _FIRST_TICK, None
    begin = time.monotonic()
    while not stopping and tick != last:
        for topic, message in sensors.messages(tick).items():
            publishers[topic].publish(message)
        if tick % STEP == BETWEEN:
            due = begin + (tick - _FIRST_TICK) * TICK / 1e9 / speed
            time.sleep(max(0.0, due - time.monotonic()))
        tick += 1
        if last is None and sensors.drive.num_ended == num_goals:
            last = tick + _LAST_TICKS
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
