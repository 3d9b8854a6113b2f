# SPDX-License-Identifier: Apache-2.0

"""What a sampler logs about steps that lack something."""

from types import SimpleNamespace as Message

import pytest

from cmifs_ros.collect.robot_file import parse_robot_file
from cmifs_ros.collect.sampling.sampler import SECOND, Sampler
from cmifs_ros.ros import sampler_status
from cmifs_ros.ros.sampler_status import SamplerStatus

ROBOT = """
step: {topic: /a}
channels: {a: /a.data, %s}
reward: a
episode: {steps: 10}
"""


@pytest.mark.parametrize(('silent', 'num_lines'), [('bcd', 3), ('bcdef', 1)])
def test_what_steps_lack_is_logged_once_and_in_one_line_if_it_is_much(
    monkeypatch, silent, num_lines
):
    now = [0.0]
    monkeypatch.setattr(sampler_status.time, 'monotonic', lambda: now[0])
    robot = parse_robot_file(ROBOT % ', '.join(f'{name}: /{name}.data' for name in silent))
    sampler = Sampler(robot)
    status = SamplerStatus('sampler', sampler, dict.fromkeys(robot.topics, 1.0))
    lines = []
    for second in range(20):
        now[0] = float(second)
        sampler.add('/a', Message(data=1.0), second * SECOND)
        lines += status.news()
    assert len(lines) == num_lines
    said = '; '.join(f'{name}: no message' for name in 'bcd')
    if num_lines == 1:
        assert lines == [f'steps lack {said}; and 2 more, see /diagnostics; this breaks episodes']
    else:
        assert lines == [f'steps lack {name}: no message; this breaks episodes' for name in 'bcd']
