# SPDX-License-Identifier: Apache-2.0

"""Small bags, written by rosbags, of a robot that is known to the last number."""

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
SECOND = 10**9
ROBOT = """
step: {topic: /pose}
channels:
  x: /pose.pose.position.x
  noise: {path: /noise.data}
  still: /pose.pose.position.z
values:
  pay: /pay.data
reward: pay
episode: {steps: 5}
"""
#: The same with channels of each kind.
ROBOT_OF_ALL = """
step: {topic: /pose}
channels:
  x: /pose.pose.position.x
  yaw: {path: /pose.pose.orientation, as: yaw}
  noise: {path: /noise.data}
  ray: "/scan.ranges[0:20:10]"
  arm: "/arm.velocity{knee,hip}"
values:
  pay: /pay.data
reward: pay
episode: {steps: 5}
"""


def write_bag(path, num_steps=151, storage='mcap', compression=None, seed=0):
    """Write a pose, noise and pay at each 0.1 s and return states (T, 3) and pay (T,)."""
    rng = np.random.default_rng(seed)
    # Each episode, five steps and what the last one reaches, is at a place of its own, which pays.
    x = np.repeat(rng.normal(size=-(-num_steps // 6)), 6)[:num_steps]
    noise, pay = rng.normal(size=(2, num_steps))
    pay = np.concatenate([[0.0], x[:-1]]) + 0.01 * pay
    types = STORE.types
    stamp_type, header = types['builtin_interfaces/msg/Time'], types['std_msgs/msg/Header']
    point, turn = types['geometry_msgs/msg/Point'], types['geometry_msgs/msg/Quaternion']
    plugin = {'mcap': StoragePlugin.MCAP, 'db3': StoragePlugin.SQLITE3}[storage]
    writer = Writer(path, version=9, storage_plugin=plugin)
    if compression is not None:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        names = {'/pose': 'geometry_msgs/msg/PoseStamped', '/noise': 'std_msgs/msg/Float64'}
        names |= {'/pay': 'std_msgs/msg/Float64', '/scan': 'sensor_msgs/msg/LaserScan'}
        names |= {'/arm': 'sensor_msgs/msg/JointState', '/said': 'std_msgs/msg/String'}
        connections = {t: writer.add_connection(t, n, typestore=STORE) for t, n in names.items()}

        def write(topic, time, message):
            data = STORE.serialize_cdr(message, names[topic])
            writer.write(connections[topic], time, data)

        for i in range(num_steps):
            time = 100 * SECOND + i * SECOND // 10
            head = header(stamp_type(*divmod(time, SECOND)), 'map')
            number = types['std_msgs/msg/Float64']
            write('/noise', time - 1000, number(noise[i]))
            write('/pay', time - 500, number(pay[i]))
            pose = types['geometry_msgs/msg/Pose'](point(x[i], 0.0, 7.0), turn(0.0, 0.0, 0.0, 1.0))
            write('/pose', time, types['geometry_msgs/msg/PoseStamped'](head, pose))
            if i % 10 == 0:
                rays = np.ones(36, np.float32)
                scan = types['sensor_msgs/msg/LaserScan'](
                    head, 0.0, 1.0, 0.1, 0.0, 0.1, 0.0, 9.0, rays, rays[:0]
                )
                write('/scan', time, scan)
                arm = types['sensor_msgs/msg/JointState'](
                    head, ['hip', 'knee'], np.zeros(2), np.zeros(2), np.zeros(0)
                )
                write('/arm', time, arm)
                write('/said', time, types['std_msgs/msg/String']('hello'))
    return np.column_stack([x, noise, np.full(num_steps, 7.0)]), pay


def episodes_of(states, pay):
    """Return what the robot file makes of it: five steps each, paid by what is reached.

    What the last step of an episode reaches is no step: the next one begins after it.
    """
    begins = range(0, len(states) - 5, 6)
    return [(states[b : b + 5], pay[b + 1 : b + 6]) for b in begins]


def write_states_and_rewards(path, episodes, space='/robot', names=('x', 'y'), actions=()):
    """Write episodes as the selector's own topics, in a namespace; the first ones with actions."""
    types, name = STORE.types, 'sensor_msgs/msg/JointState'
    none = np.zeros(0)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {
            t: writer.add_connection(f'{space}/{t}', name, typestore=STORE)
            for t in ('state', 'reward', *(['action'] if actions else []))
        }

        def write(topic, time, names, values):
            stamp = types['builtin_interfaces/msg/Time'](*divmod(time, SECOND))
            header = types['std_msgs/msg/Header'](stamp, '')
            message = types[name](header, names, np.array(values, float), none, none)
            writer.write(topics[topic], time, STORE.serialize_cdr(message, name))

        time = 100 * SECOND
        for number, (states, rewards) in enumerate(episodes):
            for step, (state, reward) in enumerate(zip(states, rewards, strict=True)):
                time += SECOND // 10
                write('state', time, list(names), state)
                if number < len(actions):
                    write('action', time, ['turn'], actions[number][step])
                is_last = step == len(rewards) - 1
                fields = ['reward', 'terminated', 'truncated', 'episode', 'step']
                write('reward', time, fields, [reward, is_last, 0, number, step])
