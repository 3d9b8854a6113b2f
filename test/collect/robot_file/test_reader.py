# SPDX-License-Identifier: Apache-2.0

"""The robot file: what it says, and that all mistakes are told at once."""

import re
from types import SimpleNamespace as Message

import pytest

from cmifs_ros.collect.robot_file.field_path import MissingFieldError
from cmifs_ros.collect.robot_file.reader import RobotFileError, load_robot_file, parse_robot_file

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
    with pytest.raises(RobotFileError, match=r'line|not valid YAML'):
        parse_robot_file(text)


@pytest.mark.parametrize('rule', ['scan', 'yaw', 'before(scan)', 'sqrt(arm)'])
@pytest.mark.parametrize('place', ['reward: ', 'truncated: '])
def test_an_expression_that_names_an_array_is_refused_when_it_is_read(rule, place):
    text = WHOLE.replace('"before(distance) - distance + 10 * succeeded - 10 * aborted"', '"1"')
    text = text.replace('reward: "1"', f'reward: "{rule}"') if place == 'reward: ' else (
        text.replace('"step >= 300"', f'"{rule}"'))  # fmt: skip
    with pytest.raises(RobotFileError) as error:
        parse_robot_file(text)
    assert 'single numbers' in str(error.value)
    shown = str(error.value).rsplit(': ', 1)[1].split(', ')
    assert shown == ['aborted', 'battery', 'canceled', 'distance', 'step', 'succeeded', 'x']


def test_a_joint_by_its_name_is_a_single_number():
    text = WHOLE.replace('{shoulder,elbow}', '{elbow}').replace('step >= 300', 'arm > 1')
    assert 'arm' in parse_robot_file(text).channel_names


def test_the_yaw_of_what_is_no_quaternion_is_refused_in_words():
    yaw = parse_robot_file(WHOLE).sources[1]
    pose = Message(position=1, orientation=Message(x=0, y=0, z=0, w=1))
    said = 'is a SimpleNamespace of orientation, position; expected a quaternion of w, x, y, z'
    with pytest.raises(MissingFieldError, match=said):
        yaw.readings(Message(pose=Message(pose=Message(orientation=pose))))


@pytest.mark.parametrize(
    ('kinds', 'value', 'expected'),
    [('[0, 2, -1]', 2, [0, 1, 0]), ('[0, 2, -1]', -1.0, [0, 0, 1]), ('[0, 1]', True, [0, 1]),
     ('[0, 3]', b'\x03', [0, 1]), ('[idle, lifting it]', 'idle', [1, 0]), ('[0, 1]', '1', [0, 1])],
)  # fmt: skip
def test_a_number_or_a_word_that_is_one_of_kinds(kinds, value, expected):
    text = WHOLE.replace('  x: /odom', f'  k: {{path: /k.data, one_hot: {kinds}}}\n  x: /odom')
    robot = parse_robot_file(text)
    assert robot.groups['k'] == robot.sources[0].names == robot.channel_names[: len(expected)]
    assert robot.channel_names[0] == f'k.{kinds[1:].split(",")[0]}'
    assert robot.sources[0].readings(Message(data=value)) == expected


@pytest.mark.parametrize(
    ('source', 'said'),
    [
        ('path: /k.data, one_hot: [0]', r'k.one_hot is \[0\]; expected whole numbers or words'),
        ('path: /k.data, one_hot: 3', "k.one_hot is '3'; expected whole numbers"),
        ('path: /k.data, one_hot: [0.5, 1]', r'k.one_hot is \[0.5, 1\]; expected'),
        ('path: /k.data, one_hot: [a, 1]', r'k.one_hot is \[a, 1\]; expected'),
        ('path: /k.data, one_hot: [{}, 1]', 'k.one_hot is'),
        ('path: /k.data, one_hot: [1, 1]', 'repeated names: k.1'),
        ('path: /k.q, one_hot: [0, 1], as: yaw', 'k has one_hot; expected a channel of a single'),
        ('path: "/k.data[0:3]", one_hot: [0, 1]', 'k has one_hot; expected a channel of a single'),
    ],
)
def test_kinds_that_cannot_be_are_refused(source, said):
    with pytest.raises(RobotFileError, match=f'^line [45]: .*{said}'):
        parse_robot_file(WHOLE.replace('channels:\n', f'channels:\n  k: {{{source}}}\n'))


@pytest.mark.parametrize(
    ('right', 'wrong', 'said'),
    [
        (
            'channels:',
            'chanels:',
            "the file has 'chanels' (did you mean 'channels'?); expected step",
        ),
        (
            'reward:',
            'reward: suceeded\nignored:',
            "reward uses suceeded (did you mean 'succeeded'?)",
        ),
    ],
)
def test_a_misspelt_word_is_answered_with_the_one_most_like_it(right, wrong, said):
    with pytest.raises(RobotFileError, match=re.escape(said)):
        parse_robot_file(WHOLE.replace(right, wrong))


def test_only_the_names_that_are_repeated_are_called_so():
    text = WHOLE.replace('channels:\n', 'channels:\n  k: {path: /k.data, one_hot: [1, 1]}\n')
    with pytest.raises(RobotFileError, match=r'repeated names: k\.1$'):
        parse_robot_file(text)


TASK = """
step: {rate: 10}
channels: {x: /odom.x, mode: {path: /mode.data, one_hot: [idle, up]}, scan: "/scan.ranges[2:5]"}
values: {status: /task/status.data}
reward: "%s"
episode: {terminated: "%s"}
"""


def test_a_value_that_is_a_text_has_a_value_for_each_word_it_is_compared_with():
    robot = parse_robot_file(TASK % ("status == 'done'", "status != 'going' or mode == 'up'"))
    status = robot.sources[-1]
    assert status.names == ('status.done', 'status.going')
    assert status.readings(Message(data='going')) == [0, 1]
    assert status.readings(Message(data='Going')) == [0, 0]
    assert robot.channel_names == ('x', 'mode.idle', 'mode.up', 'scan[2]', 'scan[3]', 'scan[4]')
    with pytest.raises(MissingFieldError, match=r'/task/status\.data is a number; expected a text'):
        status.readings(Message(data=3))


@pytest.mark.parametrize(
    ('reward', 'end', 'said'),
    [
        ("status == 'a'", 'status', "line 4: status is compared with 'a' and used as a number"),
        ("x == 'a'", '1', "line 5: reward compares x with 'a'; expected a text defined under"),
        ('1', "mode == 'down'", "compares mode with 'down'; expected one of its one_hot: idle, up"),
        ('1', "spam == 'a'", "line 6: episode.terminated compares spam with 'a'; expected a text"),
        ('mode', '1', "numbers (of its categories: mode == 'idle')"),
        ('scan', '1', 'for one entry of an array, add under values: scan_0: "/scan.ranges[2]"'),
    ],
)
def test_texts_and_numbers_are_not_mixed_up(reward, end, said):
    with pytest.raises(RobotFileError, match=re.escape(said)) as error:
        parse_robot_file(TASK % (reward, end))
    assert str(error.value).count('line') == 1


@pytest.mark.parametrize('name', ['step', 'succeeded', 'aborted', 'canceled', 'before', 'min'])
@pytest.mark.parametrize('section', ['channels', 'values'])
def test_our_own_words_are_no_names(name, section):
    text = WHOLE.replace(f'{section}:\n', f'{section}:\n  {name}: /a.data\n')
    with pytest.raises(RobotFileError, match=f"{section} has '{name}', which has another meaning"):
        parse_robot_file(text)


def test_a_value_cannot_have_the_name_of_a_channel_that_is_an_array():
    with pytest.raises(RobotFileError, match="line 10: values has 'scan'"):
        parse_robot_file(WHOLE.replace('values:\n', 'values:\n  scan: /a.data\n'))


def test_types_are_taken_from_wherever_they_are_named():
    text = WHOLE.replace('{topic: /odom}', '{topic: /odom, type: nav_msgs/msg/Odometry}').replace(
        'as: yaw}', 'as: yaw, type: nav_msgs/msg/Odometry}'
    )
    assert parse_robot_file(text).types == {'/odom': 'nav_msgs/msg/Odometry'}
    text = text.replace('yaw, type: nav_msgs/msg/Odometry', 'yaw, type: nav_msgs/msg/Path')
    with pytest.raises(
        RobotFileError, match=r'line 5: .*; expected nav_msgs/msg/Odometry as above'
    ):
        parse_robot_file(text)


@pytest.mark.parametrize('kind', ['Odometry', '[a]', 'os/path/join', '{}', 'a/srv/B', '../msg/B'])
@pytest.mark.parametrize('where', ['{topic: /odom', '{path: /odom.q'])
def test_what_is_no_type_is_refused(kind, where):
    text = WHOLE.replace('  x: /odom.pose.pose.position.x', '  x: {path: /odom.q}')
    text = text.replace(where, f'{where}, type: {kind}')
    with pytest.raises(RobotFileError, match=r'expected a type such as nav_msgs/msg/Odometry'):
        parse_robot_file(text)


def test_a_type_of_no_topic_and_a_yaw_of_an_array_are_refused():
    text = WHOLE.replace('{topic: /odom}', '{rate: 5, type: a_msgs/msg/B}')
    text = text.replace('inf: range_max', 'as: yaw')
    with pytest.raises(RobotFileError) as error:
        parse_robot_file(text)
    assert 'line 2: step.type is given without step.topic' in str(error.value)
    assert 'line 7: scan has as; expected a quaternion' in str(error.value)


@pytest.mark.parametrize(
    ('line', 'step_seconds', 'gamma'),
    [('{gamma: 0.9}', 1, 0.9), ('{gamma: 1}', 0.1, 1.0), ('{half_life: 20.0}', 0.1, 0.5**0.005)],
)
def test_a_discount_is_a_factor_or_a_half_life(line, step_seconds, gamma):
    robot = parse_robot_file(WHOLE + f'discount: {line}\n')
    assert robot.discount.per_step(step_seconds) == pytest.approx(gamma, rel=1e-12)
    assert parse_robot_file(WHOLE).discount is None


@pytest.mark.parametrize(
    ('line', 'said'),
    [
        ('discount: 0.9', "discount is '0.9'; expected a mapping"),
        ('discount: {gamma: 0}', 'discount.gamma is 0; expected more'),
        ('discount: {gamma: 1.1}', "discount.gamma is '1.1'; expected a number from 0.0 to 1.0"),
        ('discount: {half_life: 0}', "discount.half_life is '0'; expected a number from"),
        ('discount: {gamma: 0.9, half_life: 1}', 'neither or both of gamma and half_life'),
        ('discount: {lambda: 1}', "discount has 'lambda'; expected gamma, half_life"),
        ('source: robot', "source is 'robot'; expected none, bag, folder"),
        ('source: [bag]', 'source is a list; expected none, bag, folder'),
    ],
)
def test_a_discount_or_a_source_that_cannot_be_is_refused(line, said):
    with pytest.raises(RobotFileError, match=re.escape(said)):
        parse_robot_file(WHOLE + f'{line}\n')


def test_the_topics_of_some_channels_are_those_that_they_and_the_reward_need():
    robot = parse_robot_file(WHOLE + 'source: folder\n')
    needed = {'/odom', '/goal_distance', '/navigate_to_pose/_action/status'}
    assert set(robot.topics_for([])) == needed
    assert set(robot.topics_for(['scan[30]'])) == needed | {'/scan'}
    assert set(robot.topics) == needed | {'/scan', '/battery_state', '/joint_states'}


def test_a_robot_file_in_the_users_own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv('HOME', str(tmp_path))
    (tmp_path / 'robot.yaml').write_text(WHOLE)
    assert load_robot_file('~/robot.yaml').rate is None


def test_actions_and_target_are_read():
    text = WHOLE + (
        'actions:\n  turn: /cmd_vel.angular.z\n'
        '  gripper: {path: /grip.data, one_hot: [open, closed], max_age: .inf}\ntarget: decision\n'
    )
    robot = parse_robot_file(text)
    assert robot.action_names == ('turn', 'gripper.open', 'gripper.closed')
    assert 'turn' not in robot.channel_names
    assert {'/cmd_vel', '/grip'} <= set(robot.topics_for([]))
    assert robot.target == 'decision'
    assert parse_robot_file(WHOLE).target is None
    assert parse_robot_file(WHOLE).action_names == ()


def test_a_file_needs_no_reward_where_the_action_is_the_target():
    without = re.sub('reward: .*\n', '', WHOLE)
    with pytest.raises(RobotFileError, match="the file has no 'reward'"):
        parse_robot_file(without)
    robot = parse_robot_file(without + 'target: action\nactions: {turn: /cmd_vel.angular.z}\n')
    assert (robot.reward, robot.target) == (None, 'action')
    with pytest.raises(RobotFileError, match="the file has no 'actions'; add what the robot does"):
        parse_robot_file(without + 'target: action\n')


@pytest.mark.parametrize(
    ('more', 'message'),
    [
        ('target: returns', "target is 'returns'; expected return, decision, action"),
        ('target: [return]', 'target is a list; expected return'),
        ('actions: {x: /cmd_vel.angular.z}', "actions has 'x', which is used above"),
        ('actions: {step: /cmd_vel.angular.z}', "actions has 'step', which has another meaning"),
        ('actions: {turn: /cmd_vel}', 'turn is a topic without a field'),
        ('actions: {}', 'no actions; expected at least one'),
        ('actions: [turn]', 'actions is a list; expected a mapping'),
    ],
)
def test_mistakes_in_actions_and_target_are_told(more, message):
    with pytest.raises(RobotFileError, match=re.escape(message)):
        parse_robot_file(f'{WHOLE}{more}\n')


@pytest.mark.parametrize(
    ('old', 'new', 'said'),
    [
        (
            '"/scan.ranges[0:90:30]"',
            '/scan.ranges[0:90:30]',
            'line 7: not valid YAML (.*); put quo',
        ),
        ('"/joint_states.position{shoulder,elbow}"', '/j.position{a: 3}', 'line 8: .*; put quotes'),
    ],
)
def test_a_path_that_lacks_its_quotes_is_named(old, new, said):
    with pytest.raises(RobotFileError, match=said):
        parse_robot_file(WHOLE.replace(old, new))


def test_the_channels_that_the_reward_is_made_of_are_known():
    text = WHOLE.replace('reward: "', 'reward: "x + before(battery) + ')
    assert parse_robot_file(text).reward_channels == ('x', 'battery')
    assert parse_robot_file(WHOLE).reward_channels == ()
    path = re.sub('reward: .*', 'reward: /battery_state.percentage', WHOLE)
    assert parse_robot_file(path).reward_channels == ('battery',)


def with_channel(line):
    return f'step: {{rate: 10}}\nchannels:\n  {line}\nreward: "1"\n'


@pytest.mark.parametrize(
    ('line', 'count', 'names'),
    [
        ('eye: {path: /camera/image_raw, as: image}', 15, {'eye[0,0]', 'eye[0,4]', 'eye[4,0]'}),
        ('scan: {path: /scan, as: scan}', 12, {'scan[0]', 'scan[11]'}),
        ('scan: {path: /scan, as: scan, sectors: 4}', 4, {'scan[3]'}),
        ('lidar: {path: /points, as: cloud, max_range: 5.0}', 12, {'lidar[0]'}),
        ('lidar: {path: /points, as: cloud, heights: [0.1, 1, .inf], sectors: 3}', 6,
         {'lidar[0,0]', 'lidar[1,2]'}),
    ],
)  # fmt: skip
def test_messages_of_many_numbers_are_one_sensor_each(line, count, names):
    robot = parse_robot_file(with_channel(line))
    assert len(robot.channel_names) == count
    assert names <= set(robot.channel_names)
    assert list(robot.groups) == [line.split(':')[0]]


@pytest.mark.parametrize(
    ('options', 'said'),
    [
        ('as: picture', "c.as is 'picture'; expected yaw, image, scan, cloud"),
        ('as: image, sectors: 4', 'c has sectors; expected it with as: scan or as: cloud only'),
        ('max_range: 4', 'c has max_range; expected it with as: cloud only'),
        ('as: scan, sectors: 0', "c.sectors is '0'; expected a whole number from 1 to 360"),
        ('as: scan, sectors: 12.5', "c.sectors is '12.5'; expected a whole number"),
        ('as: scan, inf: range_max', 'c has as; expected a sensor_msgs/LaserScan, without'),
        ('as: cloud, heights: [1]', 'c.heights is 1 numbers; expected the limits of bands'),
        ('as: cloud, heights: [1, 0]', r'c.heights is \[1.0, 0.0\]; expected ascending numbers'),
        ('as: image, over: mean', 'c has over; expected numbers, without as'),
        ('max_age: 2', 'c is a topic without a field'),
    ],
)
def test_wrong_options_of_encoders_are_named(options, said):
    with pytest.raises(RobotFileError, match=rf'line 3: {said}'):
        parse_robot_file(with_channel(f'c: {{path: /t, {options}}}'))


def test_a_message_of_another_type_is_told_what_is_expected():
    robot = parse_robot_file(with_channel('eye: {path: /t, as: image}'))
    with pytest.raises(MissingFieldError, match=r'/t is a SimpleNamespace of ranges; expected a '
                       r'sensor_msgs/Image or CompressedImage for as: image'):  # fmt: skip
        robot.sources[0].readings(Message(ranges=[1.0]))
