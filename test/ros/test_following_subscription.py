# SPDX-License-Identifier: Apache-2.0

"""A subscription that follows, against real publishers of every QoS."""

import itertools

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Int32, String

from cmifs_ros.ros.following_subscription import FollowingSubscription

RELIABILITIES = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
DURABILITIES = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL
PROFILES = [
    QoSProfile(depth=10, reliability=reliability, durability=durability)
    for reliability, durability in itertools.product(RELIABILITIES, DURABILITIES)
]


def test_it_receives_from_each_publisher_of_any_qos_as_they_come_and_go(make_robot):
    listener, talker = make_robot(), make_robot()
    received = set()
    subscription = FollowingSubscription(
        listener.node, Int32, 'number', lambda msg: received.add(msg.data)
    )
    assert subscription.topic_name == '/number'
    # Every profile joins those before it, then they leave one by one.
    publishers = []

    def expect_all(base):
        def arrived():
            for number, publisher in enumerate(publishers):
                publisher.publish(Int32(data=base + number))
            return received >= set(range(base, base + len(publishers)))

        listener.until(arrived)
        listener.until(lambda: subscription.publishers == ['/robot'] * len(publishers))

    for base, profile in enumerate(PROFILES):
        publishers.append(talker.node.create_publisher(Int32, 'number', profile))
        expect_all(100 * base)
    for base in range(4, 7):
        talker.node.destroy_publisher(publishers.pop())
        expect_all(100 * base)
    subscription.destroy()
    listener.until(lambda: not talker.node.count_subscribers('number'))


@pytest.mark.parametrize('reliability', RELIABILITIES)
def test_what_was_latched_before_it_began_comes_when_all_are_latched(make_robot, reliability):
    talker = make_robot()
    profile = QoSProfile(
        depth=1, reliability=reliability, durability=DurabilityPolicy.TRANSIENT_LOCAL
    )
    publisher = talker.node.create_publisher(Int32, 'number', profile)
    publisher.publish(Int32(data=7))
    listener, received = make_robot(), []
    FollowingSubscription(listener.node, Int32, 'number', received.append)
    if reliability == ReliabilityPolicy.RELIABLE:
        listener.until(lambda: received and received[-1].data == 7)
    else:  # The standard promises nothing of these: what comes later does arrive.

        def arrived():
            publisher.publish(Int32(data=8))
            return received and received[-1].data == 8

        listener.until(arrived)
    assert {msg.data for msg in received} <= {7, 8}


def test_publishers_of_another_type_are_named(make_robot):
    listener, talker = make_robot(), make_robot()
    subscription = FollowingSubscription(listener.node, Int32, 'number', lambda msg: None)
    talker.node.create_publisher(String, 'number', 10)
    listener.until(lambda: subscription.clashes == {'std_msgs/msg/String': ['/robot']})
    assert subscription.publishers == []
