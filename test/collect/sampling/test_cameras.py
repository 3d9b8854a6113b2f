# SPDX-License-Identifier: Apache-2.0

"""Images of a real bag become channels of the steps; what cannot be read is named."""

import io

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='rosbags is not here')
pytest.importorskip('PIL', reason='Pillow is not here')
from bags import SECOND, STORE
from PIL import Image
from rosbags.rosbag2 import StoragePlugin, Writer

from cmifs_ros.collect.bag import episodes_of_bag
from cmifs_ros.collect.robot_file import parse_robot_file

ROBOT = parse_robot_file("""
step: {topic: /eye/image_raw}
channels:
  eye: {path: /eye/image_raw, as: image}
  wrist: {path: /wrist/compressed, as: image}
reward: /pay.data
episode: {steps: 4}
""")


def test_images_of_a_bag_are_channels(tmp_path):
    types = STORE.types
    kinds = {
        '/eye/image_raw': 'sensor_msgs/msg/Image',
        '/wrist/compressed': 'sensor_msgs/msg/CompressedImage',
        '/pay': 'std_msgs/msg/Float64',
    }
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {t: writer.add_connection(t, k, typestore=STORE) for t, k in kinds.items()}

        def write(topic, time, *parts):
            message = types[kinds[topic]](*parts)
            writer.write(topics[topic], time, STORE.serialize_cdr(message, kinds[topic]))

        for i in range(10):
            time = 100 * SECOND + i * SECOND // 10
            stamp = types['builtin_interfaces/msg/Time'](*divmod(time, SECOND))
            header = types['std_msgs/msg/Header'](stamp, 'eye')
            file = io.BytesIO()
            Image.new('RGB', (40, 40), (3 * i, 3 * i, 3 * i)).save(file, 'PNG')
            data = np.frombuffer(file.getvalue(), np.uint8)
            write('/wrist/compressed', time, header, 'png', data)
            write('/pay', time - 1, float(i))
            # The left half is bright; the last image says it is of an unknown encoding.
            pixels = np.repeat([[20 * i, 0]], 32, axis=1).astype(np.uint8).repeat(48, axis=0)
            encoding = 'mono8' if i < 9 else 'jpg'
            write('/eye/image_raw', time, header, 48, 64, encoding, 0, 64, pixels.ravel())
    found = episodes_of_bag(tmp_path / 'bag', ROBOT)
    assert len(found.channel_names) == 30
    episode = found.episodes[0]
    state = dict(zip(found.channel_names, episode.states.T, strict=True))
    steps = np.arange(4)
    assert state['eye[0,0]'] == pytest.approx(10.0 * steps)
    # The first cosine over a left half of 1: sqrt(2) / 32 * sum of cos(pi (j + 1/2) / 32).
    half = np.sqrt(2) / 32 * np.cos(np.pi * (np.arange(16) + 0.5) / 32).sum()
    assert state['eye[0,1]'] == pytest.approx(20 * half * steps)
    assert state['eye[1,0]'] == pytest.approx(0.0, abs=1e-9)
    assert state['wrist[0,0]'] == pytest.approx(3.0 * steps)
    assert episode.rewards == pytest.approx(1.0 + steps)
    assert any(
        "/eye/image_raw has the encoding 'jpg'; expected one of mono8, " in cause
        for cause in found.dropped
    )
