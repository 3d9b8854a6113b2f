# SPDX-License-Identifier: Apache-2.0

"""The page of a camera that matters shows the frames at which it does."""

import base64
import io
import re

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='rosbags is not here')
pytest.importorskip('PIL', reason='Pillow is not here')
pytest.importorskip('matplotlib')
from bags import SECOND, STORE
from PIL import Image
from rosbags.rosbag2 import StoragePlugin, Writer

from cmifs_ros.collect.example_frames import ExampleFrame
from cmifs_ros.tools.frame_gallery import gallery
from cmifs_ros.tools.select_from_bag import main

STEPS, EPISODES = 4, 60
ROBOT = """
step: {topic: /tick}
channels:
  eye: {path: /eye/image_raw, as: image}
  other: {path: /other/image_raw, as: image}
  speed: /speed.data
reward: /pay.data
episode: {steps: 4}
"""


def write_bag(path, first, count, seed):
    """Write a bag whose reward is how bright the eye's picture is; return that of each step."""
    rng, types = np.random.default_rng(seed), STORE.types
    kinds = {'/eye/image_raw': 'sensor_msgs/msg/Image', '/other/image_raw': 'sensor_msgs/msg/Image'}
    kinds |= dict.fromkeys(('/tick', '/speed', '/pay'), 'std_msgs/msg/Float64')
    bright = rng.integers(0, 200, size=count)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {t: writer.add_connection(t, k, typestore=STORE) for t, k in kinds.items()}

        def write(topic, time, *parts):
            message = types[kinds[topic]](*parts)
            writer.write(topics[topic], time, STORE.serialize_cdr(message, kinds[topic]))

        def show(topic, time, value):
            stamp = types['builtin_interfaces/msg/Time'](*divmod(time, SECOND))
            header = types['std_msgs/msg/Header'](stamp, 'eye')
            write(topic, time, header, 8, 16, 'mono8', 0, 16, np.full(128, value, np.uint8))

        for i in range(count):
            time = (first + i) * SECOND
            # The newest picture counts, and the one after the step is another.
            show('/eye/image_raw', time - SECOND // 2, 255)
            show('/eye/image_raw', time - SECOND // 4, bright[i])
            show('/other/image_raw', time - SECOND // 4, rng.integers(0, 200))
            write('/speed', time - SECOND // 8, rng.normal())
            write('/tick', time, 0.0)
            write('/pay', time + SECOND // 8, bright[i] / 100 + 0.1 * rng.normal())
    return bright


def test_the_page_shows_the_frames_at_which_the_camera_changes_the_prediction_most(tmp_path):
    # A window of four steps has five; the one between two windows belongs to none.
    count = EPISODES // 2 * (STEPS + 1) + 1
    (tmp_path / 'bags').mkdir()
    bright = [
        write_bag(tmp_path / 'bags' / name, first, count, seed)
        for name, first, seed in (('one', 5000, 0), ('another', 100, 1))
    ]
    (tmp_path / 'robot.yaml').write_text(ROBOT)
    arguments = [tmp_path / 'bags', '--robot', tmp_path / 'robot.yaml', '--out', tmp_path / 'out']
    assert main([*map(str, arguments), '--report', str(tmp_path / 'page')]) == 0
    page = (tmp_path / 'page' / 'index.html').read_text()
    assert 'Where eye matters most' in page
    assert 'eye changes the prediction of the return most' in page
    assert 'Where other matters' not in page
    figures = re.findall(
        r'<figure><img alt="[^"]*" src="data:image/png;base64,([^"]*)"><figcaption>([+-][\d.]+): '
        r'episode (\d+), step (\d+)</figcaption></figure>', page,
    )  # fmt: skip
    assert len(figures) == 8
    assert len({episode for _, _, episode, _ in figures}) >= 4
    levels = []
    # The bag that was recorded first comes first.
    steps = np.concatenate([of_bag[:-1].reshape(-1, STEPS + 1) for of_bag in bright[::-1]])
    for data, value, episode, step in figures:
        pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))
        assert pixels.shape == (8, 16)
        assert (pixels == steps[int(episode), int(step)]).all()
        levels.append((float(value), int(pixels[0, 0])))
    raising, lowering = levels[:4], levels[4:]
    assert all(value > 0 and bright > 150 for value, bright in raising)
    assert all(value < 0 and bright < 50 for value, bright in lowering)


@pytest.mark.parametrize(
    ('variable', 'words'),
    [
        ('reward', 'the prediction of the reward most'),
        ('predicts <x>', 'the prediction of the next value of &lt;x&gt; most'),
        ('action_drive', 'the prediction of action_drive most'),
    ],
)
def test_what_is_predicted_is_in_words(variable, words):
    frame = ExampleFrame(np.zeros((3, 4), np.uint8), variable, -1.25, 3, 0)
    page = gallery('<eye>', [frame])
    assert words in page
    assert '&lt;eye&gt;' in page
    assert '<figcaption>-1.2: episode 3, step 0</figcaption>' in page
