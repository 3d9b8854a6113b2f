"""The robot file: what it says, and that all mistakes are told at once."""

import pytest

from cmifs_ros.collect.robot_file import RobotFileError, parse_robot_file

WHOLE = """
step: {topic: /odom}
channels:
  x: /odom.pose.pose.position.x
  yaw: {path: /odom.pose.pose.orientation, as: yaw}
  battery: {path: /battery_state.percentage, max_age: .inf}
  scan: {path: "/scan.ranges[0:90:30]", inf: range_max}
  arm: "/joint_states.position{shoulder,elbow}"
values:
  distance: /goal_distance.data
reward: "before(distance) - distance + 10 * succeeded - 10 * aborted"
episode: {action: /navigate_to_pose, truncated: "step >= 300"}
"""


def test_a_whole_file():
    robot = parse_robot_file(WHOLE)
    assert robot.channel_names == (
        'x', 'yaw.sin', 'yaw.cos', 'battery', 'scan[0]', 'scan[30]', 'scan[60]',
        'arm.shoulder', 'arm.elbow',
    )  # fmt: skip
    assert robot.groups['arm'] == ('arm.shoulder', 'arm.elbow')
    assert set(robot.groups) == {'yaw', 'scan', 'arm'}
    assert '/navigate_to_pose/_action/status' in robot.topics
    assert robot.topics[0] == '/odom'


def test_all_mistakes_are_told_with_their_lines():
    text = (
        WHOLE.replace('as: yaw', 'as: jaw').replace('0:90:30', '0:').replace('step >=', 'stop >=')
    )
    with pytest.raises(RobotFileError) as error:
        parse_robot_file(text)
    lines = str(error.value).splitlines()
    assert [line.split(':')[0] for line in lines] == ['line 5', 'line 7', 'line 12']
    assert "'jaw'; expected yaw" in lines[0]


@pytest.mark.parametrize(
    'text', ['', '[]', 'a: [', '!!python/object:os.system {}', 'step: 3', WHOLE + 'rewards: 1\n',
             'step: {rate: 0}\nchannels: {}\nreward: 9**9**9\n', '{[a]: 1}', '[' * 2000]
)  # fmt: skip
def test_what_is_no_robot_file_is_refused_in_words(text):
    with pytest.raises(RobotFileError, match=r'line|no YAML'):
        parse_robot_file(text)
