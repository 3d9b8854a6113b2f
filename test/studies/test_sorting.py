# SPDX-License-Identifier: Apache-2.0

"""A user asks a bag which topics can be switched off, and what it would cost."""

import json
import re

import pytest

pytest.importorskip('rosbags', reason='rosbags is not here')
pytest.importorskip('matplotlib')

from cmifs_ros.collect.observed_bag import robot_file_of_bag
from studies.robot.sorting import main


def test_the_page_says_to_keep_the_hue_what_can_go_and_what_each_costs(tmp_path, capsys):
    assert main(['--boxes', '120', '--seed', '1', '--out', str(tmp_path)]) == 0
    selection = json.loads((tmp_path / 'selection.json').read_text())
    assert (selection['target'], selection['names']) == ('decision', ['hue'])
    page = (tmp_path / 'page' / 'index.html').read_text()
    keep, go, undecided = (
        re.findall('<li>(.*?)</li>', part) for part in re.split('<h3>', page)[1:]
    )
    assert len(keep) == 1
    assert keep[0].startswith('/camera/hue: ')
    # A bit of the hue's noise, and the share that few episodes do not show, are missing from 1.
    share = float(re.search(r'adds ([\d.]+)%', keep[0])[1])
    assert 50 < share <= 100
    # Two pieces a second, ten scans; a Float64 is 4 bytes of header and 8 of value.
    assert keep[0].endswith('2 messages/s, 24 B/s')
    shown = dict(line.split(': ', 1) for line in go)
    assert len(shown) >= 4
    assert shown.keys() | {line.split(': ')[0] for line in undecided} == {
        '/belt/weight', '/belt/speed', '/motor/temperature', '/microphone/loudness', '/lidar/scan'
    }  # fmt: skip
    for line in shown.values():
        assert re.search(r'adds at most [01]\.\d%; (2|10) messages/s, [\d.]+ k?B/s', line)
    # Who begins with make_robot_file finds the action proposed, and not among the channels.
    text = robot_file_of_bag(tmp_path / 'bag')
    channels, _, actions = text.partition('\n# actions:\n')
    assert '/gripper/command' not in channels
    assert actions.startswith('#   gripper_command: "/gripper/command.data"\n')
    printed = capsys.readouterr().out
    assert 'keep these:\n  /camera/hue: ' in printed
    assert main(['--out', str(tmp_path)]) == 1
    assert 'bag exists; expected a folder without it' in capsys.readouterr().err
