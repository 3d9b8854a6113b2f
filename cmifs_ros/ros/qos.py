# SPDX-License-Identifier: Apache-2.0

"""The QoS of the nodes' own topics."""

from rclpy.qos import DurabilityPolicy, QoSProfile

STREAM_QOS = QoSProfile(depth=1000)
LATCHED_QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
