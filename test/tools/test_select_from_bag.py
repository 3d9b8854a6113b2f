# SPDX-License-Identifier: Apache-2.0

import io
import itertools
import json
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='rosbags is not here')
from bags import ROBOT, STORE, episodes_of, write_bag, write_states_and_rewards
from rosbags.rosbag2 import StoragePlugin, Writer

from cmifs_ros.collect.bag import episodes_of_bag
from cmifs_ros.collect.encoders import Scan, Yaw
from cmifs_ros.collect.episodes.file_reader import read_episodes
from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.sampling.bag_reader import BagError, open_bag
from cmifs_ros.core import ConditionalMISelector
from cmifs_ros.core.selecting import select
from cmifs_ros.tools.make_robot_file import main as make_robot_file
from cmifs_ros.tools.select_from_bag import main
from studies.tasks.control import rollout_control

#: The robot file with relative names of topics.
RELATIVE = ROBOT.replace(' /', ' ')


@pytest.fixture
def robot(tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text(ROBOT)
    return str(path)


def file_of(bag):
    """Return the one file of a bag's folder that holds messages."""
    return next(path for path in bag.iterdir() if path.suffix in {'.mcap', '.db3'})


@pytest.mark.parametrize(
    ('storage', 'compression'),
    [('mcap', None), ('db3', None), ('db3', 'MESSAGE'), ('db3', 'FILE'), ('mcap', 'STORAGE')],
)
def test_a_bag_gives_the_episodes_that_were_written(tmp_path, storage, compression):
    expected = episodes_of(*write_bag(tmp_path / 'bag', 42, storage, compression))
    bag = episodes_of_bag(tmp_path / 'bag', parse_robot_file(ROBOT))
    assert bag.channel_names == ('x', 'noise', 'still')
    assert len(bag.episodes) == len(expected) == 7
    for episode, (states, rewards) in zip(bag.episodes, expected, strict=True):
        np.testing.assert_array_equal(episode.states, states)
        np.testing.assert_array_equal(episode.rewards, rewards)
    assert bag.num_read == 3 * 42


def test_several_bags_are_pooled_and_everything_is_written(tmp_path, robot, capsys):
    bags = [str(tmp_path / name) for name in ('one', 'two')]
    expected = [
        episode
        for seed, (path, storage) in enumerate(zip(bags, ('mcap', 'db3'), strict=True))
        for episode in episodes_of(*write_bag(path, 90, storage, seed=seed))
    ]
    out, saved = tmp_path / 'out', tmp_path / 'episodes'
    options = ['--out', str(out), '--episodes-file', str(saved), '--report', str(out / 'page')]
    assert main([*bags, '--robot', robot, *options]) == 0
    printed = capsys.readouterr().out
    assert '270 messages, 15 complete episodes' in printed
    assert '95 % interval' in printed
    # A message each 0.1 s, but for the two ends; a Float64 is 4 bytes of header and 8 of value.
    keep, _, rest = printed.partition('keep these:\n')[2].partition('can go')
    assert keep.startswith('  /pose: x adds')
    assert '; 10.1 messages/s, ' in keep
    assert re.search('/noise: noise adds .*; 10.1 messages/s, 121 B/s', keep + rest)
    selection = json.loads((out / 'selection.json').read_text())
    assert (selection['ranking'][0], selection['sensors'][0]['status']) == ('x', 'confirmed')
    assert 'still' not in selection['names']
    assert selection['episodes'] == 30
    assert (out / 'selection.png').read_bytes().startswith(b'\x89PNG')
    assert '<h1>Selected: x' in (out / 'page' / 'index.html').read_text()
    found = read_episodes(saved, max_episodes=100, max_bytes=10**9)
    assert found.channel_names == ('x', 'noise', 'still')
    assert found.selection.names == tuple(selection['names'])
    for episode, (states, rewards) in zip(found.episodes, expected, strict=True):
        np.testing.assert_array_equal(episode.states, states)
        np.testing.assert_array_equal(episode.rewards, rewards)


def test_the_episodes_file_can_be_taken_up_where_nothing_was_selected(tmp_path):
    write_bag(tmp_path / 'bag', 60)
    file, saved = tmp_path / 'robot.yaml', tmp_path / 'episodes'
    file.write_text(ROBOT.replace('  x: /pose.pose.position.x\n', ''))
    options = ['--robot', str(file), '--out', str(tmp_path), '--episodes-file', str(saved)]
    assert main([str(tmp_path / 'bag'), *options]) == 0
    assert json.loads((tmp_path / 'selection.json').read_text())['names'] == []
    found = read_episodes(saved, max_episodes=100, max_bytes=10**9)
    assert (len(found.episodes), found.selection) == (10, None)


def test_an_episodes_file_that_another_program_makes_meanwhile_is_not_replaced(
    tmp_path, robot, capsys, monkeypatch
):
    write_bag(tmp_path / 'bag', 90)
    saved = tmp_path / 'episodes'

    class Output(io.StringIO):
        def write(self, text):
            if text.startswith('selected: '):
                saved.write_text('of a selector')
            return super().write(text)

    monkeypatch.setattr('sys.stdout', Output())
    options = ['--robot', robot, '--out', str(tmp_path), '--episodes-file', str(saved)]
    assert main([str(tmp_path / 'bag'), *options]) == 1
    assert f'{saved} exists by now, and is not replaced' in capsys.readouterr().err
    assert saved.read_text() == 'of a selector'
    assert (tmp_path / 'selection.json').exists()


def test_a_reward_that_is_always_the_same_is_told(tmp_path, capsys):
    write_bag(tmp_path / 'bag', 60)
    file = tmp_path / 'robot.yaml'
    file.write_text(ROBOT.replace('reward: pay', 'reward: "2"'))
    assert main([str(tmp_path / 'bag'), '--robot', str(file), '--out', str(tmp_path)]) == 1
    assert 'every reward is 2, in all 10 episodes: no return differs' in capsys.readouterr().err


@pytest.mark.parametrize('is_simulated', [False, True])
def test_what_is_worth_recording_is_written_as_arguments(tmp_path, robot, is_simulated):
    write_bag(tmp_path / 'bag', 300)
    bag = with_clock(tmp_path / 'bag') if is_simulated else tmp_path / 'bag'
    file = tmp_path / 'robot.yaml'
    # A sensor that is a worse copy of the pay's cause, and one that says nothing, on own topics.
    file.write_text(ROBOT.replace('channels:', 'channels:\n  ray: "/scan.ranges[0:2]"'))
    topics = tmp_path / 'new' / 'topics'
    options = ['--robot', str(file), '--out', str(tmp_path), '--topics', str(topics)]
    assert main([str(bag), *options]) == 0
    selection = json.loads((tmp_path / 'selection.json').read_text())
    status = {sensor['name']: sensor['status'] for sensor in selection['sensors']}
    assert (status['x'], status['ray']) == ('confirmed', 'dispensable')
    expected = {'/pose', '/pay'} | ({'/noise'} if status['noise'] != 'dispensable' else set())
    expected |= {'/clock'} if is_simulated else set()
    mark, *named = topics.read_text().split()
    assert (mark, set(named)) == ('--topics', expected)


def test_topics_cannot_be_told_without_a_robot_file(tmp_path, capsys):
    assert main(['bag', '--topics', str(tmp_path / 'topics')]) == 1
    assert '--topics needs --robot' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('line', 'options', 'said'),
    [
        ('', (), 'gamma 0.95 per step of 0.1 s'),
        ('', ('--gamma', '1'), 'gamma 1 per step of 0.1 s: late rewards count in full'),
        ('', ('--half-life', '0.2'), 'gamma 0.7071 per step of 0.1 s: a reward counts half after '
         '2 steps, 0.2 s'),
        ('discount: {half_life: 0.1}', (), 'gamma 0.5 per step of 0.1 s'),
        ('discount: {half_life: 0.1}', ('--gamma', '0.8'), 'gamma 0.8 per step of 0.1 s'),
    ],
)  # fmt: skip
def test_the_discount_is_said_and_used(tmp_path, capsys, line, options, said):
    write_bag(tmp_path / 'bag', 60)
    file = tmp_path / 'robot.yaml'
    file.write_text(f'{ROBOT}{line}\n')
    path = str(tmp_path / 'bag')
    assert main([path, '--robot', str(file), '--out', str(tmp_path), *options]) == 0
    assert f'discount: {said}' in capsys.readouterr().out
    scores = json.loads((tmp_path / 'selection.json').read_text())['scores']
    bag = episodes_of_bag(path, parse_robot_file(ROBOT))
    gamma = float(re.search(r'gamma ([\d.]+)', said)[1])
    gamma = 0.5**0.5 if gamma == 0.7071 else gamma
    selector = ConditionalMISelector(gamma=gamma).fit(bag.episodes, bag.channel_names)
    np.testing.assert_allclose(scores, selector.scores_, rtol=1e-6)


def test_a_half_life_that_no_step_fits_in_is_refused(tmp_path, robot, capsys):
    write_bag(tmp_path / 'bag', 60)
    options = ['--robot', robot, '--out', str(tmp_path), '--half-life', '1e-6']
    assert main([str(tmp_path / 'bag'), *options]) == 1
    assert (
        'discounts a reward to 0 within a step of 0.1 s; expected a longer one'
        in capsys.readouterr().err
    )


def test_jobs_change_nothing(tmp_path, robot):
    bags = [str(tmp_path / name) for name in ('one', 'two')]
    for seed, path in enumerate(bags):
        write_bag(path, 60, seed=seed)
    for jobs in ('1', '2'):
        options = ['--out', str(tmp_path / jobs), '--num-features', '1', '--jobs', jobs]
        assert main([*bags, '--robot', robot, *options]) == 0
    one, two = (json.loads((tmp_path / j / 'selection.json').read_text()) for j in '12')
    assert one | {'seconds': 0} == two | {'seconds': 0}


def spoilt(path, how):
    """Write a bag, spoil it and return its path."""
    if how == 'missing':
        return path
    write_bag(path, 10 if how == 'short' else 42)
    if how == 'foreign':
        file = path.with_suffix('.mcap')
        file.write_bytes(b'no bag at all' * 100)
        return file
    if how == 'truncated':
        file = file_of(path)
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    return path


@pytest.mark.parametrize(
    ('how', 'said'),
    [
        ('missing', 'does not exist'),
        ('foreign', 'cannot be read as a bag'),
        ('truncated', 'repair a truncated bag with `mcap recover` (MCAP)'),
        ('short', '1 complete episode; expected at least 20'),
    ],
)
def test_a_bag_that_cannot_be_used_is_one_sentence(tmp_path, robot, how, said, capsys):
    path = spoilt(tmp_path / 'bag', how)
    assert main([str(path), '--robot', robot, '--out', str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count('\n') == 1
    assert not (tmp_path / 'selection.json').exists()


def test_ends_that_never_come_or_that_last_are_told(tmp_path, capsys):
    states, _ = write_bag(tmp_path / 'bag', 42)
    file = tmp_path / 'robot.yaml'
    options = [str(tmp_path / 'bag'), '--robot', str(file), '--out', str(tmp_path)]
    file.write_text(ROBOT.replace('steps: 5', 'terminated: x > 100'))
    assert main(options) == 1
    assert 'no end in 41 steps: define when an episode ends' in capsys.readouterr().err
    file.write_text(ROBOT.replace('steps: 5', 'terminated: x > 0'))
    main(options)
    is_over = states[:, 0] > 0
    num_ends = np.count_nonzero(is_over[1:] & ~is_over[:-1])
    said = capsys.readouterr().out
    assert f'{num_ends} complete episode' in said
    assert f' {np.count_nonzero(is_over) - num_ends} steps between episodes' in said


def test_a_topic_that_the_bag_lacks_is_an_error(tmp_path, capsys):
    write_bag(tmp_path / 'bag', 42)
    (tmp_path / 'robot.yaml').write_text(ROBOT.replace('/noise.data', '/battery.percentage'))
    assert main([str(tmp_path / 'bag'), '--robot', str(tmp_path / 'robot.yaml')]) == 1
    assert 'lacks /battery of the robot file; it has /arm, /noise' in capsys.readouterr().err


def test_a_relative_name_means_the_topic_in_whatever_namespace_it_was_recorded(tmp_path):
    expected = episodes_of(*write_bag(tmp_path / 'bag', 42))
    for path in (tmp_path / 'bag', in_namespace('robot1', tmp_path / 'bag')):
        bag = episodes_of_bag(path, parse_robot_file(RELATIVE))
        assert len(bag.episodes) == len(expected) == 7
        np.testing.assert_array_equal(bag.episodes[6].states, expected[6][0])


def test_what_is_worth_recording_has_the_names_under_which_it_was_recorded(tmp_path):
    bags = [tmp_path / 'bag', tmp_path / 'other']
    for seed, path in enumerate(bags):
        write_bag(path, 150, seed=seed)
    (tmp_path / 'robot.yaml').write_text(RELATIVE)
    topics = tmp_path / 'topics'
    recorded = map(str, map(in_namespace, ('one', 'two'), bags))
    options = ['--robot', str(tmp_path / 'robot.yaml'), '--out', str(tmp_path)]
    assert main([*recorded, *options, '--topics', str(topics)]) == 0
    named = topics.read_text().split()
    assert named[0] == '--topics'
    assert {'/one/pose', '/one/pay', '/two/pose', '/two/pay'} <= set(named)
    assert set(named[1:]) <= {f'/{s}/{t}' for s in ('one', 'two') for t in ('pose', 'pay', 'noise')}
    assert len(set(named)) == len(named)


def test_two_names_of_one_topic_are_an_error(tmp_path, capsys):
    write_bag(tmp_path / 'bag', 42)
    file = tmp_path / 'robot.yaml'
    file.write_text(ROBOT.replace('/noise.data}', 'noise.data}\n  again: {path: /noise.data}'))
    assert main([str(tmp_path / 'bag'), '--robot', str(file)]) == 1
    said = 'noise and /noise of the robot file are both /noise; expected one name for it'
    assert said in capsys.readouterr().err


def test_a_type_that_the_bag_does_not_have_is_an_error(tmp_path, capsys):
    write_bag(tmp_path / 'bag', 42)
    file = tmp_path / 'robot.yaml'
    file.write_text(ROBOT.replace('/noise.data}', '/noise.data, type: std_msgs/msg/Float32}'))
    assert main([str(tmp_path / 'bag'), '--robot', str(file)]) == 1
    said = '/noise is of type std_msgs/msg/Float64, not std_msgs/msg/Float32 as in the robot file'
    assert said in capsys.readouterr().err


def test_a_field_that_a_message_lacks_is_named(tmp_path):
    write_bag(tmp_path / 'bag', 12)
    fields = '{path: /noise.level}\n  wind: {path: /noise.wind}'
    robot = parse_robot_file(ROBOT.replace('{path: /noise.data}', fields))
    with pytest.raises(BagError, match=r"wind: /noise has no field 'wind'; expected one of data"):
        episodes_of_bag(tmp_path / 'bag', robot)


def in_namespace(space, path):
    """Write a bag anew, with its topics in a namespace, and return its path."""
    again = path.with_name(f'{path.name}_{space}')
    with open_bag(path) as reader, Writer(
        again, version=9, storage_plugin=StoragePlugin.MCAP
    ) as writer:  # fmt: skip
        topics = {
            topic: writer.add_connection(f'/{space}{topic}', info.msgtype, typestore=STORE)
            for topic, info in reader.topics.items()
        }
        for connection, time, data in reader.messages(reader.topics):
            writer.write(topics[connection.topic], time, data)
    return again


@contextmanager
def anew(path, again):
    """Open a bag and a writer of another, with the writer's connections by topic."""
    with open_bag(path) as reader, Writer(
        again, version=9, storage_plugin=StoragePlugin.MCAP
    ) as writer:  # fmt: skip
        yield (
            reader,
            writer,
            {
                c.topic: writer.add_connection(c.topic, c.msgtype, typestore=reader.types.store)
                for c in reader.connections
            },
        )


def with_clock(path):
    """Write a bag anew, with the time of recording as /clock, and return its path."""
    again, kind = path.with_name('simulated'), 'rosgraph_msgs/msg/Clock'
    with anew(path, again) as (reader, writer, topics):
        clock = writer.add_connection('/clock', kind, typestore=STORE)
        for connection, time, data in reader.messages(reader.topics):
            stamp = STORE.types['builtin_interfaces/msg/Time'](*divmod(time, 10**9))
            writer.write(clock, time, STORE.serialize_cdr(STORE.types[kind](stamp), kind))
            writer.write(topics[connection.topic], time, data)
    return again


def changed(path, change):
    """Write a bag anew with other bytes, by topic and bytes, and return its path."""
    again = path.with_name('changed')
    with anew(path, again) as (reader, writer, topics):
        for connection, time, data in reader.messages(reader.topics):
            writer.write(topics[connection.topic], time, change(connection.topic, bytes(data)))
    return again


def test_bytes_left_at_the_end_of_messages_change_nothing(tmp_path):
    """So rclpy's serialize_message leaves a JointState without velocities."""
    expected = episodes_of(*write_bag(tmp_path / 'bag', 42))
    path = changed(tmp_path / 'bag', lambda topic, data: data + b'abcdefgh')
    bag = episodes_of_bag(path, parse_robot_file(ROBOT))
    assert not any('wrong' in cause for cause in bag.dropped)
    for episode, (states, _) in zip(bag.episodes, expected, strict=True):
        np.testing.assert_array_equal(episode.states, states)


def test_messages_that_cannot_be_decoded_are_counted_and_the_rest_is_read(tmp_path, capsys):
    write_bag(tmp_path / 'bag', 42)
    noises = itertools.count()

    def change(topic, data):
        is_torn = topic == '/said' or (topic == '/noise' and next(noises) == 20)
        return data[:6] if is_torn else data

    path = changed(tmp_path / 'bag', change)
    bag = episodes_of_bag(path, parse_robot_file(ROBOT))
    ((cause, count),) = ((cause, n) for cause, n in bag.dropped.items() if 'wrong' in cause)
    said = 'wrong messages of /noise, such as: std_msgs/msg/Float64 cannot be decoded: '
    assert (cause.startswith(said), count, 'recover' in cause) == (True, 1, False)
    assert len(bag.episodes) == 7  # What it said before is not too old.
    assert make_robot_file(['--bag', str(path)]) == 0
    assert '# /said: std_msgs/msg/String cannot be decoded: ' in capsys.readouterr().out


def test_what_one_topic_lacks_is_told_once_and_causes_come_before_what_follows(tmp_path, capsys):
    write_bag(tmp_path / 'bag', 42)
    file = tmp_path / 'robot.yaml'
    # The scans come once a second, and are used for half of one.
    rays = ''.join(f'  ray_{i}: {{path: "/scan.ranges[{i}]", max_age: 0.5}}\n' for i in range(9))
    file.write_text(ROBOT.replace('channels:\n', f'channels:\n{rays}'))
    main([str(tmp_path / 'bag'), '--robot', str(file), '--out', str(tmp_path)])
    dropped = re.findall(r'  dropped (\d+): (.*)', capsys.readouterr().out)
    why = 'its messages come every 1 s, max_age is 0.5 s'
    assert dropped[0][1] == f'steps without 9 channels of /scan: {why}'
    assert dropped[-1][1].startswith('episodes ')


def test_without_a_robot_file_a_bag_needs_state_and_reward(tmp_path, capsys):
    write_bag(tmp_path / 'bag', 42)
    assert main([str(tmp_path / 'bag')]) == 1
    assert 'a robot file is missing (--robot FILE): ' in capsys.readouterr().err


def test_a_bag_of_states_and_rewards_needs_no_robot_file(tmp_path):
    rng = np.random.default_rng(0)
    written = [(rng.normal(size=(n, 2)), rng.normal(size=n)) for n in (3, 5, 4)]
    write_states_and_rewards(tmp_path / 'bag', written)
    bag = episodes_of_bag(tmp_path / 'bag')
    assert bag.channel_names == ('x', 'y')
    assert len(bag.episodes) == 3
    for episode, (states, rewards) in zip(bag.episodes, written, strict=True):
        np.testing.assert_array_equal(episode.states, states)
        np.testing.assert_array_equal(episode.rewards, rewards)


def test_states_and_rewards_of_a_bag_are_no_sensors(tmp_path, capsys):
    rng = np.random.default_rng(0)
    written = [(rng.normal(size=(5, 2)), rng.normal(size=5)) for _ in range(4)]
    write_states_and_rewards(tmp_path / 'bag', written)
    assert make_robot_file(['--bag', str(tmp_path / 'bag')]) == 0
    text = capsys.readouterr().out
    assert '# /robot/reward: a reward; not a sensor' in text
    assert not re.search(r'(?m)^  \w+:', text)


def test_channels_of_one_array_are_one_sensor_as_they_are_to_the_selector(tmp_path):
    rng = np.random.default_rng(0)
    written = [(rng.normal(size=(4, 3)), rng.normal(size=4)) for _ in range(30)]
    write_states_and_rewards(tmp_path / 'bag', written, names=['x', 'scan[0]', 'scan[9]'])
    assert main([str(tmp_path / 'bag'), '--out', str(tmp_path)]) == 0
    selection = json.loads((tmp_path / 'selection.json').read_text())
    assert set(selection['ranking']) == {'x', 'scan'}


def test_a_bag_and_its_copy_count_once(tmp_path, robot, capsys):
    write_bag(tmp_path / 'bag', 151)
    write_bag(tmp_path / 'copy', 151)
    bags = [str(tmp_path / 'bag'), str(tmp_path / 'copy')]
    assert main([*bags, '--robot', robot, '--out', str(tmp_path)]) == 0
    assert '25 of 25 episodes left out, because they were recorded twice' in capsys.readouterr().out
    assert json.loads((tmp_path / 'selection.json').read_text())['episodes'] == 25


def test_an_error_of_the_caller_is_not_blamed_on_the_bag(tmp_path):
    write_bag(tmp_path / 'bag', 42)

    def watch(messages, total):
        for message in messages:
            yield message
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        episodes_of_bag(tmp_path / 'bag', parse_robot_file(ROBOT), watch)


def test_an_interruption_is_one_sentence(tmp_path, robot):
    write_bag(tmp_path / 'bag', 2001)
    process = subprocess.Popen(
        [sys.executable, '-u', '-m', 'cmifs_ros.tools.select_from_bag', str(tmp_path / 'bag'),
         '--robot', robot, '--out', str(tmp_path)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=dict(os.environ),
    )  # fmt: skip
    for line in process.stdout:
        if line.startswith('selecting'):
            break
    process.send_signal(signal.SIGINT)
    begin = time.monotonic()
    rest = process.communicate(timeout=30)[0]
    assert process.returncode == 130
    assert time.monotonic() - begin < 10
    assert 'interrupted; nothing is written' in rest
    assert 'Traceback' not in rest


def test_a_reader_that_stops_reading_such_as_head_ends_it_in_silence(tmp_path, robot):
    write_bag(tmp_path / 'bag', 2001)
    process = subprocess.Popen(
        [sys.executable, '-u', '-m', 'cmifs_ros', 'select', str(tmp_path / 'bag'),
         '--robot', robot],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ),
    )  # fmt: skip
    process.stdout.readline()
    process.stdout.close()
    assert process.wait(60) == 128 + signal.SIGPIPE
    assert process.stderr.read() == ''
    process.stderr.close()


def test_a_robot_file_is_made_that_lacks_only_the_reward(tmp_path, capsys):
    write_bag(tmp_path / 'bag', 42)
    assert make_robot_file(['--bag', str(tmp_path / 'bag')]) == 0
    text = capsys.readouterr().out
    with pytest.raises(
        ValueError, match=r"^line \d+: the file has no 'reward'; add the reward"
    ) as e:
        parse_robot_file(text)
    assert int(re.search(r'\d+', str(e.value))[0]) == text.count('\n')
    made = parse_robot_file(f'{text}\nreward: "1"\n')
    assert {source.path.topic for source in made.sources} == {'/pose', '/noise', '/pay'}
    assert '"/pose.pose.position.z"  # never changed: 7\n' in text
    robot = parse_robot_file(re.sub('(?m)^  # ', '  ', text) + '\nreward: "1"\n')
    assert {source.path.topic for source in robot.sources} == {
        '/pose', '/noise', '/pay', '/scan', '/arm'
    }  # fmt: skip
    paths = {source.name: source for source in robot.sources}
    (scan,) = (s for s in robot.sources if s.path.topic == '/scan')
    assert scan.encoder == Scan()
    (arm,) = (s for s in robot.sources if s.path.topic == '/arm' and 'position' in s.path.fields)
    assert arm.path.names == ('hip', 'knee')
    (turn,) = (s for s in robot.sources if s.encoder == Yaw())
    assert turn.path.fields == ('pose', 'orientation')
    assert len(paths) == len(robot.sources)
    assert "# /said is text: 'hello'\n" in text
    with pytest.raises(BagError, match='does not exist'), open_bag(tmp_path / 'nothing'):
        pass


@pytest.mark.parametrize(
    ('found', 'then'),
    [
        ('ros2', 'ros2 run cmifs_ros select_from_bag'),
        ('cmifs', 'cmifs select'),
        ('other', 'install/cmifs_ros/lib/cmifs_ros/select_from_bag'),
    ],
)
def test_what_to_do_with_a_robot_file_is_told(tmp_path, monkeypatch, capsys, found, then):
    write_bag(tmp_path / 'bag', 10)
    (tmp_path / 'bin').mkdir()
    (tmp_path / 'bin' / found).touch(0o755)
    monkeypatch.setenv('PATH', str(tmp_path / 'bin'))
    out = tmp_path / 'new.yaml'
    assert make_robot_file(['--bag', str(tmp_path / 'bag'), '--out', str(out)]) == 0
    assert f', then run: {then} {tmp_path / "bag"} --robot {out}\n' in capsys.readouterr().out


def test_states_and_rewards_are_known_by_their_stamps_in_a_long_bag_too(tmp_path, capsys):
    """The recorder heard the states first: no two messages have the same place in their topics."""
    rng = np.random.default_rng(0)
    written = [(rng.normal(size=(50, 2)), rng.normal(size=50)) for _ in range(50)]
    write_states_and_rewards(tmp_path / 'bag', written)
    called = {'/robot/state': '/seen', '/robot/reward': '/paid'}
    kind = 'sensor_msgs/msg/JointState'
    with open_bag(tmp_path / 'bag') as reader, Writer(
        tmp_path / 'again', version=9, storage_plugin=StoragePlugin.MCAP
    ) as writer:  # fmt: skip
        topics = {t: writer.add_connection(to, kind, typestore=STORE) for t, to in called.items()}
        for number, (connection, time, data) in enumerate(reader.messages(reader.topics)):
            if number > 300 or connection.topic == '/robot/state':
                writer.write(topics[connection.topic], time, data)
    assert make_robot_file(['--bag', str(tmp_path / 'again')]) == 0
    text = capsys.readouterr().out
    assert '# /paid: a reward; not a sensor' in text
    assert '# /seen: it has the stamps of the reward /paid; not a sensor' in text


SORTING = """
step: {topic: /belt}
channels:
  hue: "/belt.position[0]"
  noise_1: "/belt.position[1]"
  noise_2: "/belt.position[2]"
actions:
  bin: {path: "/arm.position[0]", one_hot: [0, 1]}
reward: "/scale.position[0]"
episode: {steps: 12}
"""


def write_sorting_bag(path, episodes, topics=('belt', 'arm', 'scale')):
    """Write what a robot sees, does and is paid; what the last step of an episode reaches too."""
    types, kind = STORE.types, 'sensor_msgs/msg/JointState'
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {t: writer.add_connection(f'/{t}', kind, typestore=STORE) for t in topics}

        def write(topic, time, values):
            if topic in connections:
                stamp = types['builtin_interfaces/msg/Time'](*divmod(time, 10**9))
                header = types['std_msgs/msg/Header'](stamp, '')
                fields = [[], np.array(values, float), np.zeros(0), np.zeros(0)]
                data = STORE.serialize_cdr(types[kind](header, *fields), kind)
                writer.write(connections[topic], time, data)

        time = 100 * 10**9
        for episode in episodes:
            steps = zip(episode.states, episode.actions, episode.rewards, strict=True)
            for state, action, reward in [*steps, (episode.states[-1], episode.actions[-1], 0.0)]:
                write('belt', time, state[:3])
                write('arm', time + 10**7, action)
                write('scale', time + 2 * 10**7, [reward])
                time += 10**8


@pytest.fixture
def sort(tmp_path):
    """Select from a bag of a robot that sorts pieces; return what is selected."""

    def sort_(episodes, text, *options, topics=('belt', 'arm', 'scale')):
        write_sorting_bag(tmp_path / 'bag', episodes, topics)
        (tmp_path / 'sorting.yaml').write_text(text)
        own = ['--robot', str(tmp_path / 'sorting.yaml'), '--out', str(tmp_path)]
        assert main([str(tmp_path / 'bag'), *own, *options]) == 0
        return json.loads((tmp_path / 'selection.json').read_text())['names']

    return sort_


def test_what_a_sorting_robot_needs_shows_by_its_actions(sort, tmp_path):
    saved = ['--episodes-file', str(tmp_path / 'episodes')]
    sent = rollout_control('match', 60, seed=1)
    assert sort(sent, SORTING, *saved) == ['hue']
    found = read_episodes(tmp_path / 'episodes')
    assert found.action_names == ('bin.0', 'bin.1')
    for episode, expected in zip(found.episodes, sent, strict=True):
        np.testing.assert_array_equal(episode.actions[:, [1]], expected.actions)
        np.testing.assert_array_equal(episode.rewards, expected.rewards)


def test_a_demonstration_without_a_reward_shows_what_the_action_depends_on(sort):
    text = SORTING.replace('reward: "/scale.position[0]"', 'target: action')
    skilled = rollout_control('match', 40, seed=1, is_skilled=True)
    assert sort(skilled, text, topics=('belt', 'arm')) == ['hue']


def test_no_evidence_is_enough_for_a_significance_of_almost_0(sort, tmp_path):
    assert sort(rollout_control('match', 30, seed=1), SORTING, '--significance', '1e-300') == []
    assert json.loads((tmp_path / 'selection.json').read_text())['level'] == 1e-300


DARK = """
step: {topic: /belt}
channels:
  slope: "/belt.position[0]"
  range: "/arm.position[0]"
  light: "/arm.position[1]"
values: {hit: "/scale.position[0]", home: "/scale.position[1]"}
reward: "0.1 - 10 * hit"
episode: {terminated: hit, truncated: home}
"""


def test_where_all_failures_are_lost_nothing_can_go_and_it_is_told(tmp_path, capsys):
    rng, path = np.random.default_rng(4), tmp_path / 'bag'
    types, kind = STORE.types, 'sensor_msgs/msg/JointState'
    num_failures = 0
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            topic: writer.add_connection(f'/{topic}', kind, typestore=STORE)
            for topic in ('belt', 'arm', 'scale')
        }
        time = 100 * 10**9
        for _ in range(90):
            slope, length = rng.normal(), int(rng.integers(14, 24))
            fails = bool(slope > 0)
            num_failures += fails
            for step in range(length + 2):  # The last two are of no episode.
                is_end, is_dark = step == length - 1, fails and length - 10 < step < length
                said = {
                    'belt': [slope + 0.1 * rng.normal()],
                    'arm': [np.nan, np.nan] if is_dark else rng.normal(size=2),
                    'scale': [fails and is_end, step >= length or (is_end and not fails)],
                }
                stamp = types['builtin_interfaces/msg/Time'](*divmod(time, 10**9))
                header = types['std_msgs/msg/Header'](stamp, '')
                for topic, values in said.items():
                    fields = [[], np.array(values, float), np.zeros(0), np.zeros(0)]
                    data = STORE.serialize_cdr(types[kind](header, *fields), kind)
                    writer.write(connections[topic], time, data)
                time += 10**8
    (tmp_path / 'dark.yaml').write_text(DARK)
    out = ['--out', str(tmp_path), '--report', str(tmp_path / 'page')]
    assert main([str(path), '--robot', str(tmp_path / 'dark.yaml'), *out]) == 0
    said = capsys.readouterr().out
    found = json.loads((tmp_path / 'selection.json').read_text())
    lost = f'dropped {num_failures} episodes that ended by `terminated`: a step lacks 2 channels'
    assert found['losses'].startswith(lost)
    assert f'none of {num_failures} is left' in found['losses']
    warning = 'the episodes left are biased, so no sensor is dispensable'
    assert found['warnings'][0] == f'{found["losses"]}; {warning}'
    words = ' '.join(said.split())
    assert words.index(warning) < words.index('selected:')
    assert warning in ' '.join((tmp_path / 'page' / 'index.html').read_text().split())
    assert found['advice']['can_go'] == []
    assert {one['name'] for one in found['advice']['undecided']} == {'/arm', '/belt'}
    assert words.rpartition('undecided: ')[2].count('(biased episodes)') == 3
    # By these episodes alone something could go.
    recording = episodes_of_bag(path, parse_robot_file(DARK))
    alone = select(recording.episodes, recording.channel_names, 'conditional_mi', {})
    assert {sensor.status for sensor in alone.sensors} & {'dispensable'}
    assert not alone.losses


def test_a_discount_that_the_target_does_not_use_is_told(sort, tmp_path, capsys):
    text = SORTING + 'target: decision\ndiscount: {half_life: 20.0}\n'
    assert sort(rollout_control('match', 30, seed=1), text) == ['hue']
    assert 'note: the discount is not used: with the target decision' in capsys.readouterr().out
    assert json.loads((tmp_path / 'selection.json').read_text())['gamma'] is None


def test_the_option_target_goes_before_the_robot_file(sort):
    text = SORTING + 'target: action\n'
    assert sort(rollout_control('match', 60, seed=1), text, '--target', 'decision') == ['hue']


def test_the_action_as_target_needs_actions(tmp_path, robot, capsys):
    write_bag(tmp_path / 'bag', 60)
    assert main([str(tmp_path / 'bag'), '--robot', robot, '--target', 'action']) == 1
    said = "target is 'action', but the episodes have no actions: add `actions` to the robot file"
    assert said in capsys.readouterr().err


def test_files_in_the_order_of_their_outcome_are_not_taken_for_drift(tmp_path):
    # Each episode is at a place of its own, which pays; the bags are sorted by it.
    rng = np.random.default_rng(0)
    places = np.sort(rng.normal(size=40))
    episodes = [
        (np.column_stack([np.full(5, p), rng.normal(size=5)]), p + 0.1 * rng.normal(size=5))
        for p in places
    ]
    write_states_and_rewards(tmp_path / 'bag', episodes)
    found = {}
    for order in ('time', 'none'):
        options = ['--out', str(tmp_path), '--order', order]
        assert main([str(tmp_path / 'bag'), *options]) == 0
        selection = json.loads((tmp_path / 'selection.json').read_text())
        found[order] = selection['names']
    assert found['none'] == ['x']
    assert found['time'] == []


def test_a_bag_of_states_and_rewards_brings_the_actions_beside_them(tmp_path):
    sent = rollout_control('match', 4, seed=1)
    episodes = [(episode.states[:, :2], episode.rewards) for episode in sent]
    actions = [episode.actions for episode in sent[:3]]  # Then they fall silent.
    write_states_and_rewards(tmp_path / 'bag', episodes, actions=actions)
    bag = episodes_of_bag(tmp_path / 'bag')
    assert bag.action_names == ('turn',)
    assert [len(episode) for episode in bag.episodes] == [12] * 4
    for episode, expected in zip(bag.episodes, actions, strict=False):
        np.testing.assert_array_equal(episode.actions, expected)
    assert bag.episodes[3].actions.shape == (12, 0)
    assert not bag.dropped


def test_more_features_than_sensors_are_refused_before_reading(tmp_path, capsys):
    file = tmp_path / 'robot.yaml'
    file.write_text(ROBOT)
    write_bag(tmp_path / 'bag', 12)
    assert main([str(tmp_path / 'bag'), '--robot', str(file), '--num-features', '40']) == 1
    shown = capsys.readouterr()
    assert re.search(r'--num-features is 40; expected at most \d+, the number of', shown.err)
    assert 'messages' not in shown.out


def test_a_bag_without_messages_gives_no_robot_file(tmp_path, capsys):
    with Writer(tmp_path / 'empty', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.add_connection('/a', 'std_msgs/msg/Float64', typestore=STORE)
    out = tmp_path / 'robot.yaml'
    assert make_robot_file([str(tmp_path / 'empty'), '--out', str(out)]) == 1
    assert 'empty has no readable message, so there is no channel' in capsys.readouterr().err
    assert not out.exists()


def test_a_folder_of_bags_gives_the_name_of_one(tmp_path, capsys):
    write_bag(tmp_path / 'day' / 'bag', 12)
    assert make_robot_file([str(tmp_path / 'day')]) == 1
    assert f'expected one of them, such as {tmp_path / "day" / "bag"}' in capsys.readouterr().err
    assert make_robot_file([str(tmp_path / 'day' / 'bag')]) == 0
    assert 'channels:' in capsys.readouterr().out
