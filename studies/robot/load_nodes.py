# SPDX-License-Identifier: Apache-2.0

"""The publisher of the load, `load_nodes publish SECONDS`, and nodes that receive it.

`listen` and `listen_raw` only count. `relay` republishes the odometry, as a controller would get it
without a sampler; `control` receives this and `selected_state`.
"""

from __future__ import annotations

import json
import signal
import sys
import time
from functools import partial

import rclpy
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Imu, JointState, LaserScan
from std_msgs.msg import String

from cmifs_ros.ros.conversions import stamp_to_nanoseconds
from cmifs_ros.ros.qos import LATCHED_QOS, STREAM_QOS
from cmifs_ros.ros.run_node import make_executor

_JOINTS = [f'joint_{i}' for i in range(12)]
#: A message, its period in seconds, and its quality of service, by topic.
TOPICS = {
    '/odom': (Odometry(), 1 / 50, QoSProfile(depth=10)),
    '/scan': (LaserScan(range_max=8.0, ranges=[1.0] * 720), 1 / 20, qos_profile_sensor_data),
    '/imu': (Imu(), 1 / 400, qos_profile_sensor_data),
    '/joint_states': (
        JointState(name=_JOINTS, position=[0.5] * 12, velocity=[0.0] * 12, effort=[0.0] * 12),
        1 / 500, QoSProfile(depth=10),
    ),
}  # fmt: skip
PERIODS = {topic: period for topic, (_, period, _) in TOPICS.items()}
#: The channels of the robot file that `control` selects.
SELECTED = ['x', 'acceleration', 'joints[3]']
#: Depth of the subscriptions, like the sampler's.
_DEPTH = 1000


def publish(node, seconds: float, stopping: list) -> dict[str, int]:
    """Publish each topic at its rate; return the numbers sent."""
    publishers = {t: node.create_publisher(type(m), t, qos) for t, (m, _, qos) in TOPICS.items()}
    while not stopping and not all(p.get_subscription_count() for p in publishers.values()):
        time.sleep(0.1)
    # The subscriber is discovered here; it takes longer to discover this publisher.
    time.sleep(2.0)
    print('begin', flush=True)
    sent = dict.fromkeys(TOPICS, 0)
    begin = time.monotonic()
    while not stopping:
        topic = min(sent, key=lambda t: sent[t] * PERIODS[t])
        due = sent[topic] * PERIODS[topic]
        if due >= seconds:
            break
        wait = begin + due - time.monotonic()
        if wait > 0:
            time.sleep(wait)
        message = TOPICS[topic][0]
        message.header.stamp = node.get_clock().now().to_msg()
        publishers[topic].publish(message)
        sent[topic] += 1
    for publisher in publishers.values():
        publisher.wait_for_all_acked()
    return sent


def listen(node, raw: bool, stopping: list) -> dict[str, int]:
    """Count messages until told to stop; return the numbers."""
    counts = dict.fromkeys(TOPICS, 0)

    def count(topic: str) -> None:
        counts[topic] += 1

    for topic, (message, _, qos) in TOPICS.items():
        profile = QoSProfile(depth=_DEPTH, reliability=qos.reliability)
        node.create_subscription(
            type(message), topic, lambda _, topic=topic: count(topic), profile, raw=raw
        )
    spin(node, stopping)
    return counts


def relay(node, stopping: list) -> dict[str, int]:
    """Republish the odometry like the sampler; return the number."""
    publisher = node.create_publisher(JointState, 'relayed', STREAM_QOS)
    counts = {'relayed': 0}

    def pass_on(odometry: Odometry) -> None:
        x = odometry.pose.pose.position.x
        publisher.publish(JointState(header=odometry.header, name=['x'], position=[x]))
        counts['relayed'] += 1

    node.create_subscription(Odometry, '/odom', pass_on, QoSProfile(depth=_DEPTH))
    spin(node, stopping)
    return counts


def control(node, stopping: list) -> dict[str, list[int]]:
    """Select, and receive both ways until told to stop; return stamps and ages by way, in ns."""
    selection = String(data=json.dumps({'number': 1, 'names': SELECTED}))
    publisher = node.create_publisher(String, 'selection', LATCHED_QOS)
    publisher.publish(selection)
    ages: dict[str, dict[int, int]] = {'relayed': {}, 'selected_state': {}}

    def receive(way: str, state: JointState) -> None:
        stamp = stamp_to_nanoseconds(state.header.stamp)
        ages[way][stamp] = time.time_ns() - stamp

    for way in ages:
        node.create_subscription(JointState, way, partial(receive, way), STREAM_QOS)
    spin(node, stopping)
    both = ages['relayed'].keys() & ages['selected_state'].keys()
    return {way: [of[stamp] for stamp in sorted(both)] for way, of in ages.items()}


def spin(node, stopping: list) -> None:
    """Spin until told to stop."""
    executor = make_executor()
    executor.add_node(node)
    while not stopping:
        executor.spin_once(0.1)


def main() -> None:
    """Run one of them; the last line is what it returns, as JSON."""
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopping.append(number))
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    role = sys.argv[1]
    node = rclpy.create_node(f'load_{role}')
    if role == 'publish':
        found = publish(node, float(sys.argv[2]), stopping)
    elif role == 'relay':
        found = relay(node, stopping)
    elif role == 'control':
        found = control(node, stopping)
    else:
        found = listen(node, role == 'listen_raw', stopping)
    print(json.dumps(found), flush=True)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
