# SPDX-License-Identifier: Apache-2.0

"""docs/robot_file.md: its examples are valid robot files, and errors read as it shows."""

import re
from math import isfinite
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cmifs_ros.collect.robot_file.expression import FUNCTIONS
from cmifs_ros.collect.robot_file.model import OWN_VALUES
from cmifs_ros.collect.robot_file.reader import RobotFileError, parse_robot_file

PAGE = Path(__file__, '../../../../docs/robot_file.md').resolve().read_text()
EXAMPLES = re.findall(r'```yaml\n(.*?)```', PAGE, re.DOTALL)


def test_the_examples_are_robot_files_with_the_channels_that_the_page_names():
    nav2, windows = map(parse_robot_file, EXAMPLES)
    for name in ('yaw.sin', 'yaw.cos', 'scan[0]', 'scan[30]', 'wheel.left_wheel'):
        assert name in PAGE
        assert name in nav2.channel_names
    assert set(nav2.groups) == {'yaw', 'scan', 'wheel'}
    assert len(nav2.groups['scan']) == 12
    assert (windows.rate, windows.steps, set(windows.groups)) == (10, 25, {'scan'})


def test_the_rewards_of_common_tasks_are_valid_in_a_robot_file():
    tasks = re.findall(r'^\| (?!Task)[^`|\n]+ \| `(.*)` \| `(.*)` \|$', PAGE, re.MULTILINE)
    assert len(tasks) == 5
    for reward, episode in tasks:
        names = set(re.findall('[a-z]+', reward)) - OWN_VALUES - FUNCTIONS.keys() - {'before'}
        channels = ''.join(f'  {name}: /{name}.data\n' for name in names)
        robot = parse_robot_file(
            f'step: {{rate: 10}}\nchannels:\n{channels}reward: "{reward}"\nepisode: {episode}\n'
        )
        known = dict.fromkeys(names | OWN_VALUES, 1.0)
        assert isfinite(robot.reward(known, known))
        assert robot.steps or robot.action


def test_the_encoder_of_the_page_encodes_an_image():
    (code,) = re.findall(r'```python\n(.*?)```', PAGE, re.DOTALL)
    exec(code, names := {})
    encoder = names['Redness']()
    pixels = np.zeros((2, 4, 3), np.uint8)
    pixels[:, 2:, 0], pixels[..., 1] = 200, 50
    rows = np.hstack([pixels.reshape(2, 12), np.full((2, 3), 255, np.uint8)])
    image = SimpleNamespace(height=2, width=4, encoding='rgb8', step=15, data=rows.tobytes())
    assert encoder.fits(vars(image).__contains__)
    assert dict(zip(encoder.suffixes, encoder.encode(image), strict=True)) == {
        '.left': 0.0, '.right': 200.0
    }  # fmt: skip


@pytest.mark.parametrize(
    ('wrong', 'right', 'shown'),
    [
        ('as: jaw', 'as: yaw', "yaw.as is 'jaw'; expected yaw"),
        ('reward: "scan', 'reward: "before(distance)', 'reward uses scan; expected names of'),
    ],
)
def test_errors_read_as_the_page_shows(wrong, right, shown):
    assert shown in PAGE
    with pytest.raises(RobotFileError, match=re.escape(shown)):
        parse_robot_file(EXAMPLES[0].replace(right, wrong))
