# SPDX-License-Identifier: Apache-2.0

"""What a selector that was killed leaves to the next one."""

import json
import os
import resource
import signal

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from cmifs_ros.collect.episodes import file as episode_file
from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.collect.episodes.file_format import Saved
from cmifs_ros.collect.episodes.file_reader import read_episodes
from cmifs_ros.collect.sensor_topics import SensorTopics, topic_fields
from cmifs_ros.core import Episode
from cmifs_ros.ros import conversions
from cmifs_ros.ros.qos import LATCHED_QOS

NAMES = ('a', 'b', 'c')
STORAGE = 'selector: storage'


def numbered(numbers, steps=3):
    """Return episodes that tell which they are; their reward is channel c."""
    episodes = []
    for n in numbers:
        states = np.random.default_rng(n).normal(size=(steps, 3))
        states[:, 0] = n
        episodes.append(Episode(states, states[:, 2]))
    return episodes


@pytest.fixture
def path(tmp_path):
    folder = tmp_path / 'kept'
    folder.mkdir()
    return folder / 'episodes'


@pytest.fixture
def start_selector(start, make_robot, path):
    """Start a selector that saves, and a robot that sees it."""

    def start_(**parameters):
        robot = make_robot()
        parameters = {'selection_period': 0.0, 'num_features': 1} | parameters
        node = start('selector_node', episodes_path=str(path), **parameters)
        robot.wait_for_selector()
        robot.until(lambda: STORAGE in robot.diagnostics)
        return node, robot

    return start_


def saved_numbers(path, max_episodes=1000):
    saved = read_episodes(path, max_episodes, max_bytes=10**9)
    return [int(episode.states[0, 0]) for episode in saved.episodes]


def kill(node):
    node.process.send_signal(signal.SIGKILL)
    node.process.wait()


def wait_until_relayed(robot, stamp):
    robot.publish_state(stamp, NAMES, [999.0, 0.0, 0.0])
    stamp = conversions.stamp_from_nanoseconds(stamp)
    robot.until(lambda: robot.selected and robot.selected[-1].header.stamp == stamp)


def test_a_killed_selector_comes_back_with_its_episodes_and_its_selection(start_selector, path):
    node, robot = start_selector()
    stamp = robot.publish_episodes(numbered(range(24)), NAMES)
    robot.wait_for_episodes(24)
    first = json.loads(robot.call(robot.select_client).message)
    assert first['names'] == ['c']
    stamp = robot.publish_episodes(numbered([24]), NAMES, begin=stamp)
    robot.publish_state(stamp, NAMES, [25.0, 0.0, 0.0])  # an episode that does not end
    robot.publish_reward(stamp, RewardSample(0.0, False, False, 25, 0))
    robot.wait_for_episodes(25)
    robot.until(lambda: saved_numbers(path) == list(range(25)))
    kill(node)

    node, robot = start_selector()
    robot.wait_for_episodes(25)
    assert robot.latched('selected_indices').data.tolist() == first['indices']
    assert list(robot.latched('scores', JointState).name) == first['ranking']
    _, message, values = robot.diagnostics['selector: selection']
    assert (message, values['episodes used']) == ('selected c', '24')
    assert 0 <= int(values['age in s']) < 60
    # Its advice is about topics once a sampler names them; it may have other channels, too.
    assert 'c' in json.loads(robot.latched('selection', String).data)['advice']['keep']
    sampler = robot.node.create_publisher(String, 'channel_topics', LATCHED_QOS)
    found = SensorTopics({name: f'/{name}' for name in (*NAMES, 'd')}, {}, ())
    sampler.publish(String(data=json.dumps(topic_fields(found))))
    robot.until(
        lambda: '/c' in json.loads(robot.latched('selection', String).data)['advice']['keep']
    )
    assert values['cause'] == 'restored from the file'
    robot.publish_state(stamp, NAMES, [1.0, 2.0, 3.0])
    robot.until(lambda: robot.selected)
    assert robot.selected[0].position.tolist() == [3]
    # The next episodes join those that came back.
    robot.publish_episodes(numbered([25, 26]), NAMES, begin=stamp + 1)
    robot.wait_for_episodes(27)
    robot.until(lambda: saved_numbers(path) == list(range(27)))
    again = json.loads(robot.call(robot.select_client).message)
    assert (again['names'], again['episodes']) == (['c'], 27)
    assert again['number'] == first['number'] + 1
    assert f'restored from {path}: 25 episodes; selection: c' in node.output
    # The save of that selection may still be under way.
    robot.until(lambda: sorted(os.listdir(path.parent)) == ['episodes', 'episodes.lock'])


def test_what_the_sampler_has_lost_by_its_end_is_a_warning_and_nothing_can_go(start_selector, path):
    _, robot = start_selector(num_features=0)
    sampler = robot.node.create_publisher(String, 'channel_topics', LATCHED_QOS)
    fields = topic_fields(SensorTopics({name: f'/{name}' for name in NAMES}, {}, ()))
    robot.publish_episodes(numbered(range(40)), NAMES)
    robot.wait_for_episodes(40)

    def look():
        return json.loads(robot.call(robot.select_client).message)

    for losses in ('dropped 12 episodes that ended by `aborted`', ''):
        sampler.publish(String(data=json.dumps(fields | {'losses': losses})))
        robot.until(lambda losses=losses: look()['losses'] == losses)
        found = look()
        assert found['advice']['keep'] == ['/c']
        warnings = [warning for warning in found['warnings'] if 'are biased' in warning]
        assert [warning.partition(';')[0] for warning in warnings] == [losses] * bool(losses)
        assert not (losses and found['advice']['can_go'])


def test_a_restart_gives_no_level_back(start_selector, path):
    def look(robot):
        return json.loads(robot.call(robot.select_client).message)['level']

    bounds = {'min_episodes': 4, 'max_episodes': 8}
    node, robot = start_selector(**bounds)
    stamp = robot.publish_episodes(numbered(range(8)), NAMES)
    robot.wait_for_episodes(8)
    levels = [look(robot)]
    stamp = robot.publish_episodes(numbered(range(8, 60)), NAMES, begin=stamp)
    robot.until(lambda: saved_numbers(path)[-1:] == [59])
    levels.append(look(robot))
    kill(node)
    node, robot = start_selector(**bounds)
    robot.wait_for_episodes(8)
    levels.append(look(robot))
    robot.publish_episodes(numbered([60]), NAMES, begin=stamp)
    robot.until(lambda: saved_numbers(path)[-1:] == [60])
    levels.append(look(robot))
    # One doubling since the first possible look, then 52 and 53 episodes in a buffer of 8.
    renewals = np.array([1, 1 + 52 / 8, 1 + 52 / 8, 1 + 53 / 8])
    whole = 0.05 / 3
    np.testing.assert_allclose(levels, whole / (1 + renewals / 2) ** 2)
    robot.call(robot.clear_client)
    robot.publish_episodes(numbered(range(61, 65)), NAMES, begin=stamp + 100)
    robot.wait_for_episodes(4)
    assert look(robot) == pytest.approx(whole)  # another task


def test_killed_at_any_moment_at_most_the_unfinished_episode_is_lost(start_selector, path):
    sent = 0
    for attempt in range(4):
        node, robot = start_selector()
        robot.wait_for_episodes(sent)
        # The last step of an episode of which nothing else was seen makes the channels known.
        robot.publish_state(1, NAMES, [999.0, 0.0, 0.0])
        robot.publish_reward(1, RewardSample(0.0, False, True, 0, 5))
        robot.until(path.exists)
        more = range(sent, sent + 30 + attempt)
        stamp = robot.publish_episodes(numbered(more), NAMES, begin=2)
        # By the time a second later state is relayed, all rewards are taken.
        for later in (stamp, stamp + 1):
            wait_until_relayed(robot, later)
        kill(node)
        sent = more.stop
        assert saved_numbers(path) == list(range(sent))


def test_the_last_episode_is_saved_when_the_node_is_ended(start_selector, path):
    node, robot = start_selector()
    robot.publish_episodes(numbered(range(50)), NAMES)
    robot.wait_for_episodes(50)
    assert node.end() == 0
    assert saved_numbers(path) == list(range(50))


def test_cleared_episodes_do_not_come_back(start_selector, path):
    node, robot = start_selector()
    robot.publish_episodes(numbered(range(3)), NAMES)
    robot.wait_for_episodes(3)
    robot.call(robot.clear_client)
    node.end()
    _, robot = start_selector()
    robot.publish_episodes(numbered(range(2)), ('d', 'e', 'f'))
    robot.wait_for_episodes(2)
    assert robot.value('messages dropped: wrong_channels') == 0


def test_what_was_confirmed_does_not_outlive_its_cleared_episodes(start_selector, path):
    node, robot = start_selector(num_features=0)
    robot.publish_episodes(numbered(range(40)), NAMES)
    robot.wait_for_episodes(40)
    assert json.loads(robot.call(robot.select_client).message)['names'] == ['c']
    robot.call(robot.clear_client)
    node.end()
    _, robot = start_selector(num_features=0)
    # The selection is in use until the next one, which has too few episodes to show that c does
    # not matter any more.
    robot.publish_state(1, NAMES, [1.0, 2.0, 3.0])
    robot.until(lambda: robot.selected)
    assert robot.selected[0].position.tolist() == [3]
    others = numbered(range(100, 125))
    robot.publish_episodes(
        [Episode(a.states, b.rewards) for a, b in zip(others, others[::-1], strict=True)],
        NAMES,
        begin=2,
    )
    robot.wait_for_episodes(25)
    found = json.loads(robot.call(robot.select_client).message)
    assert found['names'] == []


def test_of_more_than_there_is_room_for_the_newest_come_back(start_selector, path):
    episode_file.write(path, Saved(NAMES, numbered(range(40))))
    _, robot = start_selector(max_episodes=30)
    robot.wait_for_episodes(30)
    robot.publish_episodes(numbered([40]), NAMES)
    robot.until(lambda: saved_numbers(path)[-1] == 40)
    assert saved_numbers(path, max_episodes=30) == list(range(11, 41))


@pytest.mark.parametrize(
    ('damage', 'message'),
    [  # What else there is, test_file_reader.py knows.
        (lambda whole: whole[:-40], 'is truncated: it has '),
        (lambda whole: whole.replace(b'episodes 6', b'episodes 1'), 'is of format version 1'),
    ],
)
def test_a_file_that_cannot_be_used_is_kept_aside_and_the_node_starts_empty(
    start_selector, path, damage, message
):
    episode_file.write(path, Saved(NAMES, numbered(range(4))))
    damaged = damage(path.read_bytes())
    path.write_bytes(damaged)
    node, robot = start_selector()
    robot.until(lambda: robot.diagnostics[STORAGE][0] == b'\x02')
    assert message in robot.diagnostics[STORAGE][1]
    assert f'{path} {message}' in node.output
    assert f'it is kept as {path}.refused' in node.output
    assert path.with_name('episodes.refused').read_bytes() == damaged
    robot.wait_for_episodes(0)
    robot.publish_episodes(numbered([7, 8]), NAMES)
    robot.wait_for_episodes(2)
    robot.until(lambda: robot.diagnostics[STORAGE][0] == b'\x00')
    assert saved_numbers(path) == [7, 8]


def test_an_episode_whose_saving_was_cut_short_is_dropped_and_told(start_selector, path):
    *whole, torn = numbered(range(4))
    episode_file.write(path, Saved(NAMES, whole))
    with path.open('ab') as file:
        file.write(episode_file.record(torn)[:50])
    node, robot = start_selector()
    robot.wait_for_episodes(3)
    assert f'{path} ends with 50 bytes of an episode' in node.output
    robot.publish_episodes(numbered([4]), NAMES)
    robot.until(lambda: saved_numbers(path) == [0, 1, 2, 4])


def test_a_full_disk_is_reported_and_the_node_runs_on(start_selector, path):
    node, robot = start_selector()
    stamp = robot.publish_episodes(numbered(range(2)), NAMES)
    robot.until(lambda: path.exists() and saved_numbers(path) == [0, 1])
    unlimited = resource.prlimit(node.process.pid, resource.RLIMIT_FSIZE)
    small = (path.stat().st_size + 10, unlimited[1])
    resource.prlimit(node.process.pid, resource.RLIMIT_FSIZE, small)
    stamp = robot.publish_episodes(numbered(range(2, 24)), NAMES, begin=stamp)
    robot.until(lambda: robot.diagnostics[STORAGE][0] == b'\x02')
    assert 'cannot be saved: File too large' in robot.diagnostics[STORAGE][1]
    robot.wait_for_episodes(24)
    assert robot.call(robot.select_client).success
    assert saved_numbers(path) == [0, 1]  # the last that was written still stands
    # The save of that selection may still be under way.
    robot.until(lambda: sorted(os.listdir(path.parent)) == ['episodes', 'episodes.lock'])

    resource.prlimit(node.process.pid, resource.RLIMIT_FSIZE, unlimited)
    robot.until(lambda: robot.diagnostics[STORAGE][0] == b'\x00')
    assert saved_numbers(path) == list(range(24))
    robot.until(lambda: f'{path} can be saved again' in node.output)
    assert 'Traceback' not in node.output


def test_a_folder_in_which_nothing_can_be_saved_is_told_of_at_the_start(start, robot):
    node = start('selector_node', episodes_path='/proc/episodes')
    robot.until(lambda: robot.diagnostics.get(STORAGE, (b'',))[0] == b'\x02')
    assert '/proc/episodes cannot be saved: ' in robot.diagnostics[STORAGE][1]
    assert '/proc/episodes cannot be saved: ' in node.output


def test_the_path_cannot_be_changed_from_outside(start_selector, tmp_path):
    _, robot = start_selector()
    result = robot.set_parameter('episodes_path', str(tmp_path / 'elsewhere'))
    assert not result.successful
    assert 'read-only' in result.reason


def test_a_path_of_another_selector_or_without_a_folder_is_one_sentence(
    start_selector, start, path
):
    start_selector()
    other = start('selector_node', '-r', '__ns:=/other', episodes_path=str(path))
    assert other.process.wait(20) == 2
    assert other.output == f"episodes_path is '{path}', which another selector uses\n"
    homeless = start('selector_node', episodes_path='/nonexistent/episodes')
    assert homeless.process.wait(20) == 2
    assert homeless.output.endswith('there is no folder /nonexistent\n')
