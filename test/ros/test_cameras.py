# SPDX-License-Identifier: Apache-2.0

"""The sampler node makes channels of a camera's images, scans and clouds."""

import struct

import pytest
from sensor_msgs.msg import Image, JointState, LaserScan, PointCloud2, PointField

FILE = """
step: {topic: /eye/image_raw}
channels:
  eye: {path: /eye/image_raw, as: image}
  scan: {path: /scan, as: scan, sectors: 4}
  lidar: {path: /points, as: cloud, sectors: 4, max_range: 8.0}
reward: "1"
episode: {steps: 5}
"""


def test_images_scans_and_clouds_are_channels(start, robot, tmp_path):
    (tmp_path / 'robot.yaml').write_text(FILE)
    sampler = start('sampler_node', robot_file=tmp_path / 'robot.yaml')
    node = robot.node
    eye = node.create_publisher(Image, '/eye/image_raw', 10)
    scans = node.create_publisher(LaserScan, '/scan', 10)
    clouds = node.create_publisher(PointCloud2, '/points', 10)
    fields = [
        PointField(name=name, offset=4 * place, datatype=PointField.FLOAT32, count=1)
        for place, name in enumerate('xyz')
    ]
    states = []
    node.create_subscription(JointState, 'state', states.append, 10)

    def publish():
        stamp = node.get_clock().now().to_msg()
        length = 10 + stamp.nanosec % 7  # The number of rays varies.
        scan = LaserScan(angle_min=-0.5, angle_increment=1.0 / length, range_max=9.0)
        scan.ranges = [2.5] * length
        data = struct.pack('<6f', 0.0, 3.0, 1.0, 0.0, -4.0, 2.0)
        cloud = PointCloud2(height=1, width=2, fields=fields, point_step=12, row_step=24, data=data)
        image = Image(height=40, width=40, encoding='mono8', step=40, data=[77] * 1600)
        for publisher, message in ((scans, scan), (clouds, cloud), (eye, image)):
            message.header.stamp = stamp
            publisher.publish(message)

    node.create_timer(0.05, publish)
    robot.until(lambda: len(states) > 2)
    state = dict(zip(states[-1].name, states[-1].position, strict=True))
    assert len(state) == 15 + 4 + 4
    assert state['eye[0,0]'] == pytest.approx(77)
    assert state['eye[1,2]'] == pytest.approx(0, abs=1e-9)
    assert [state[f'scan[{i}]'] for i in range(4)] == [2.5, 9.0, 9.0, 9.0]
    assert [state[f'lidar[{i}]'] for i in range(4)] == [8.0, 3.0, 8.0, 4.0]
    assert sampler.end() == 0
