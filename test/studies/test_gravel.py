# SPDX-License-Identifier: Apache-2.0

"""A drive over gravel: what happens between two steps tells more than the newest message."""

import json

import pytest

pytest.importorskip('rosbags', reason='rosbags is not here')
pytest.importorskip('matplotlib')

from studies.robot.gravel import main


def test_vibration_is_found_and_adds_more_than_the_newest_message_alone(tmp_path):
    assert main(['--seconds', '120', '--seed', '1', '--out', str(tmp_path)]) == 0
    found = {}
    for folder in ('.', 'newest'):
        selection = json.loads((tmp_path / folder / 'selection.json').read_text())
        assert selection['names'] == ['vibration']
        (found[folder],) = (s for s in selection['sensors'] if s['name'] == 'vibration')
        assert found[folder]['status'] == 'confirmed'
    # Of twenty values, the mean square says more than one; the world has no number for how much.
    assert found['.']['effect']['share'] > 1.5 * found['newest']['effect']['share']
