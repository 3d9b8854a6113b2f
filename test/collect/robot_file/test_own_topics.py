# SPDX-License-Identifier: Apache-2.0

"""The package's own topics are known by what they say, whatever they are called."""

from types import SimpleNamespace as Message

import pytest

from cmifs_ros.collect.robot_file.own_topics import Trace, own_topics

JOINTS, INDICES = 'sensor_msgs/msg/JointState', 'std_msgs/msg/Int32MultiArray'
REWARD = ['reward', 'terminated', 'truncated', 'episode', 'step']


def joints(stamp, names, velocity=()):
    stamp = Message(sec=stamp, nanosec=5)
    header = Message(stamp=stamp, frame_id='')
    return Message(header=header, name=names, position=[0.5] * len(names), velocity=velocity,
                   effort=())  # fmt: skip


OWN = ('state', 'reward', 'selected_state', 'scores', 'selected_indices', 'action')


def traces(*called):
    """Return what was heard of a robot with joints and of topics that were made of it, as `OWN`."""
    state, reward, selected, scores, indices, action = called
    found = {name: Trace(name, JOINTS) for name in (state, reward, selected, scores, '/joints')}
    found |= {indices: Trace(indices, INDICES), action: Trace(action, 'std_msgs/msg/Int32')}
    for stamp in range(100, 160):
        found['/joints'].look(joints(stamp, ['hip', 'knee'], [0.1, 0.2]))
        if stamp % 2:
            found[state].look(joints(stamp, ['arm.hip', 'arm.knee', 'x']))
            found[reward].look(joints(stamp, REWARD))
    for stamp in range(110, 160, 3):
        found[selected].look(joints(stamp + 7, ['arm.knee', 'x']))
    found[scores].look(joints(0, ['arm', 'x']))
    found[indices].look(Message(layout=Message(dim=[Message(label='channel')])))
    return found.values()


@pytest.mark.parametrize('space', ['', '/robot1', '/a/b'])
def test_by_their_own_names_in_any_namespace(space):
    called = [f'{space}/{name}' for name in OWN]
    assert set(own_topics(traces(*called))) == set(called)


def test_by_what_they_say_if_they_are_remapped():
    called = ['/obs', '/pay', '/small', '/worth', '/which', '/action']
    own = own_topics(traces(*called))
    assert set(own) == set(called)
    assert own['/obs'] == 'it has the stamps of the reward /pay'
    assert own['/worth'] == 'it has the channel names of /obs'


def test_a_reward_of_any_type_is_no_sensor_and_what_is_beside_belongs_to_it():
    topics = ('/r/reward', '/r/state', '/state', '/odom')
    own = own_topics(Trace(topic, 'a_msgs/msg/Thing') for topic in topics)
    assert set(own) == {'/r/reward', '/r/state'}


def test_names_and_values_apart_are_those_of_a_selector_or_of_a_robot():
    kinds = {'names': 'control_msgs/msg/Keys', 'values': 'control_msgs/msg/Float64Values'}
    own, others = (
        [Trace(f'{space}/{name}', kind) for name, kind in kinds.items()]
        for space in ('/robot1/selected_state', '/state_interfaces_broadcaster')
    )
    assert set(own_topics(own + others)) == {trace.topic for trace in own}


def test_joints_without_velocities_are_sensors():
    arm, leg = Trace('/arm', JOINTS), Trace('/leg', JOINTS)
    for stamp in range(100):
        arm.look(joints(stamp, ['hip', 'knee']))
        leg.look(joints(stamp, ['left', 'right']))
    assert own_topics([arm, leg]) == {}
