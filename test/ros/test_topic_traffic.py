# SPDX-License-Identifier: Apache-2.0

"""What is counted as the traffic of a robot's topics."""

from types import SimpleNamespace

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock

from cmifs_ros.collect.robot_file import parse_robot_file
from cmifs_ros.collect.simulated_time import SimulatedTime
from cmifs_ros.collect.traffic import Rate
from cmifs_ros.ros import diagnostics
from cmifs_ros.ros.topic_traffic import TopicTraffic

ROBOT = """
step: {rate: 10}
channels: {load: "/diagnostics.status{cpu}.values{load}.value"}
reward: load
episode: {steps: 10}
"""


def traffic_of(text, *more):
    node = SimpleNamespace(
        create_publisher=lambda *_: SimpleNamespace(publish=lambda message: None),
        resolve_topic_name=lambda name: name,
    )
    return TopicTraffic(node, parse_robot_file(text), *more)


def test_in_a_simulation_rates_are_those_of_its_clock():
    simulated = SimulatedTime()
    traffic = traffic_of(ROBOT, simulated)
    for second in (1000, 1004, 1010, 1000, 1010):  # It is set back once.
        simulated.take(Clock(clock=Time(sec=second)))
        traffic.take('/diagnostics', DiagnosticArray())
        traffic.report(frozenset(), '')
    assert traffic.meter.rate('/diagnostics').messages == 5 / 20
    traffic.report(frozenset({'/diagnostics'}), '')  # It stands still.
    assert traffic.meter.saved['/diagnostics'].messages == 0


def test_the_reports_of_this_package_are_not_traffic_of_the_robot():
    traffic = traffic_of(ROBOT)
    own = diagnostics.status('sampler: steps', diagnostics.OK, 'steps are made', {})
    own_report = diagnostics.diagnostic_array(DiagnosticArray().header.stamp, own)
    robots = DiagnosticArray(status=[DiagnosticStatus(name='cpu', hardware_id='mower')])
    traffic.take('/diagnostics', own_report)
    traffic.report(frozenset(), '')
    assert traffic.meter.rate('/diagnostics') == Rate(0.0, 0.0)
    for message in (robots, own_report):
        traffic.take('/diagnostics', message)
    traffic.report(frozenset(), '')
    rate = traffic.meter.rate('/diagnostics')
    assert rate.bytes / rate.messages == pytest.approx(len(serialize_message(robots)))
