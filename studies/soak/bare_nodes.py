# SPDX-License-Identifier: Apache-2.0

"""Minimal nodes, to compare the selector with."""

from __future__ import annotations

import argparse
import signal
import sys

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32MultiArray

from cmifs_ros.ros.qos import STREAM_QOS
from cmifs_ros.ros.run_node import make_executor
from cmifs_ros.ros.selector_node import SelectorNode


class Relay(Node):
    """Republish each `state` as `selected_state`."""

    def __init__(self):
        super().__init__('relay')
        publisher = self.create_publisher(JointState, 'selected_state', STREAM_QOS)
        self.create_subscription(JointState, 'state', publisher.publish, STREAM_QOS)


class Counter(Node):
    """Count the messages on `state` and `reward`, and publish the counts ten times a second."""

    def __init__(self):
        super().__init__('counter')
        self._counts = [0, 0]
        publisher = self.create_publisher(Int32MultiArray, 'counts', 1)
        for which, topic in enumerate(('state', 'reward')):
            self.create_subscription(
                JointState, topic, lambda _, which=which: self._count(which), STREAM_QOS
            )
        self.create_timer(0.1, lambda: publisher.publish(Int32MultiArray(data=self._counts)))

    def _count(self, which: int) -> None:
        self._counts[which] += 1


NODES = {'relay': Relay, 'counter': Counter, 'selector': SelectorNode}
EXECUTORS = {'chosen': make_executor, 'single': SingleThreadedExecutor}


def main() -> None:
    """Run one of them until SIGTERM."""
    parser = argparse.ArgumentParser(prog='bare_nodes', description=__doc__)
    parser.add_argument('node', choices=NODES)
    parser.add_argument('executor', choices=EXECUTORS)
    stopping = []
    signal.signal(signal.SIGTERM, lambda *_: stopping.append(True))
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    options = parser.parse_args(rclpy.utilities.remove_ros_args(sys.argv)[1:])
    executor = EXECUTORS[options.executor]()
    node = NODES[options.node]()
    executor.add_node(node)
    while not stopping:
        executor.spin_once(0.1)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
