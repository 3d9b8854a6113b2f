# SPDX-License-Identifier: Apache-2.0

"""A robot that sorts pieces by their hue: what it needs shows with its actions alone."""

import json

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.collect.episodes.file_reader import read_episodes
from cmifs_ros.ros import conversions
from studies.tasks.control import CONTROL_WORLDS, rollout_control

NAMES = CONTROL_WORLDS['match'].channel_names
#: In nanoseconds: so short that what is under way at any moment is never late.
STEP = 10**7
ROBOT = """
step: {topic: /belt}
actions:
  bin: {path: "/arm.position[0]", one_hot: [0, 1]}
episode: {steps: 12}
target: action
channels:
"""
ROBOT += '\n'.join(f'  {name}: "/belt.position[{i}]"' for i, name in enumerate(NAMES))


def publish_all(robot, episodes, *, with_actions):
    stamp = STEP
    for number, episode in enumerate(episodes):
        for step, state in enumerate(episode.states):
            if with_actions(number, step):
                robot.publish_action(stamp, ['bin'], episode.actions[step])
            robot.publish_state(stamp, NAMES, state)
            is_last = step == len(episode) - 1
            sample = RewardSample(episode.rewards[step], False, is_last, number, step)
            robot.publish_reward(stamp, sample)
            stamp += STEP


def selected(robot):
    reply = json.loads(robot.call(robot.select_client).message)
    return reply['names'], reply['episodes']


def test_hue_is_confirmed_with_actions(start, robot, tmp_path):
    node = start('selector_node', selection_period=0.0, episodes_path=tmp_path / 'episodes')
    robot.wait_for_selector()
    robot.act()
    episodes = rollout_control('match', 60, seed=1)
    publish_all(robot, episodes, with_actions=lambda number, step: True)
    robot.wait_for_episodes(60)
    names, count = selected(robot)
    assert names == ['hue']
    assert count >= 59  # The first step may be there before it is known that there are actions.
    node.end()
    saved = read_episodes(tmp_path / 'episodes')
    assert saved.action_names == ('bin',)
    assert [e.actions.tolist() for e in saved.episodes[1:]] == [
        e.actions.tolist() for e in episodes[1:]
    ]


@pytest.mark.parametrize('target', ['return', 'action'])
def test_where_most_episodes_lack_actions_none_is_used_and_that_is_told(start, robot, target):
    node = start('selector_node', selection_period=0.0, target=target)
    robot.wait_for_selector()
    robot.act()
    publish_all(
        robot,
        rollout_control('match', 30, seed=2),
        with_actions=lambda number, step: number < 10 or step > 3,
    )
    robot.wait_for_episodes(30)
    reply = json.loads(robot.call(robot.select_client).message)
    if target == 'return':
        assert reply['names'] == []  # By the return alone hue means nothing.
        assert reply['episodes'] == 30
    else:
        assert reply['error'].startswith("target is 'action', but the episodes have no actions")
    assert 'of 30 episodes have an action at every step: actions are not used' in node.output
    assert 'an episode has actions at some of its steps only' in node.output


def test_what_a_skilled_robot_looks_at_shows_in_its_own_topics_without_a_reward(
    start, robot, tmp_path
):
    path = tmp_path / 'robot.yaml'
    path.write_text(ROBOT)
    start('selector_node', selection_period=0.0)
    start('sampler_node', robot_file=path)
    robot.wait_for_selector()
    publishers = {
        name: robot.node.create_publisher(JointState, f'/{name}', 1000) for name in ('belt', 'arm')
    }
    steps = []
    robot.node.create_subscription(JointState, 'action', steps.append, 10_000)
    robot.until(lambda: all(p.get_subscription_count() for p in publishers.values()))

    def send(topic, stamp, values):
        header = Header(stamp=conversions.stamp_from_nanoseconds(stamp))
        message = JointState(header=header, position=[float(value) for value in values])
        publishers[topic].publish(message)

    time, sent, expected = STEP, 0, []
    for episode in rollout_control('match', 60, seed=2, is_skilled=True):
        for state, action in zip(episode.states, episode.actions, strict=True):
            send('belt', time, state)
            send('arm', time + STEP // 4, action)  # Once the piece has been seen.
            time += STEP
        send('belt', time, state)  # What the last step reaches.
        time += STEP
        expected += [[1.0 - action, action] for (action,) in episode.actions.tolist()]
        sent += len(episode)
        robot.until(lambda sent=sent: len(steps) > sent - 20)
    robot.until(lambda: len(steps) == len(expected))
    assert [list(message.position) for message in steps] == expected
    assert list(steps[0].name) == ['bin.0', 'bin.1']
    robot.wait_for_episodes(60)
    reply = json.loads(robot.call(robot.select_client).message)
    assert reply['names'] == ['hue']
    assert reply['sensors'][0]['why'] in {'bin.0', 'bin.1'}
    # The advice is of topics, with what came on them.
    assert reply['advice']['keep'] == ['/belt']
    assert reply['advice']['can_go'] == []
    rate = reply['advice']['rates']['/belt']
    assert rate['messages_per_s'] > 0
    size = len(serialize_message(JointState(position=[0.0] * len(NAMES))))
    assert rate['bytes_per_s'] / rate['messages_per_s'] == pytest.approx(size, rel=0.02)
