# SPDX-License-Identifier: Apache-2.0

import csv
import sys

import numpy as np
import pytest

pytest.importorskip('joblib')
pytest.importorskip('matplotlib')

from cmifs_ros.core import Episode
from cmifs_ros.core.samples import step_samples
from cmifs_ros.sim import rollout_chain
from studies.accuracy import changing_task
from studies.accuracy import oracle as accuracy_oracle
from studies.accuracy.rank_sums import main
from studies.methods.direct_port import conditional_mi
from studies.methods.peers import information_by_channel
from studies.methods.registry import rank
from studies.tasks.distractors import distractor_names, with_distractors
from studies.tasks.environments import rollout_environment
from studies.tasks.registry import TASKS, what_is_missing

TINY = ('--trials', '2', '--episodes', '12', '--first-seed', '7')


def test_the_table_holds_mean_and_standard_error_of_the_rank_sums(tmp_path, capsys):
    log = tmp_path / 'trials.csv'
    options = [*TINY, '--tasks', 'chain,with_gravel', '--methods', 'kdr', '--log', str(log)]
    assert main([*options, '--jobs', '1']) == 0
    output = capsys.readouterr().out
    assert 'Mean and standard error of 2 trials, seeds 7 to 8.' in output
    with log.open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert [(r['scenario'], r['seed']) for r in rows] == [
        ('with_gravel', '7'), ('with_gravel', '8'), ('chain', '7'), ('chain', '8')
    ]  # fmt: skip
    for name, relevant, optimum, chance in (
        ('chain', '012', 6, 22.5),
        ('with_gravel', '0123', 10, 30),
    ):
        sums = [
            sum(row['ranking'].split().index(i) + 1 for i in relevant)
            for row in rows
            if row['scenario'] == name
        ]
        cell = f'{sum(sums) / 2:.2f} ± {abs(sums[0] - sums[1]) / 2:.2f}'
        assert f'| {name} | 12 | {optimum} | {chance:g} | {cell} |' in output

    before = log.read_bytes()
    assert main([*options, '--jobs', '2']) == 0
    assert log.read_bytes() == before


def test_the_number_selected_is_held_against_the_relevant_channels(tmp_path, capsys):
    log = tmp_path / 'trials.csv'
    options = ['--number', '--tasks', 'chain', '--episodes', '40', '--trials', '2', '--jobs', '1']
    assert main([*options, '--first-seed', '7', '--log', str(log)]) == 0
    with log.open(newline='') as file:
        rows = list(csv.DictReader(file))
    own, shuffled = (
        [set(map(int, row['ranking'].split())) for row in rows if row['method'] == method]
        for method in ('automatic', 'automatic_shuffled')
    )
    assert len(own) == len(shuffled) == 2
    assert any(own)
    shares = [
        f'{sum(cases) / 2:.0%}'
        for cases in (
            [s == {0, 1, 2} for s in own],
            [not s >= {0, 1, 2} for s in own],
            [not s <= {0, 1, 2} for s in own],
            [len(s) > 0 for s in shuffled],
        )
    ]
    row = ['chain', '40', '3', f'{sum(map(len, own)) / 2:.2f}', *shares]
    output = capsys.readouterr().out
    assert 'The automatic number in 2 trials, seeds 7 to 8.' in output
    assert f'| {" | ".join(row)} | ' in output


def test_what_is_not_installed_is_left_out_and_named(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'sklearn', None)
    monkeypatch.setitem(sys.modules, 'gymnasium', None)
    options = [*TINY, '--tasks', 'chain,taxi', '--methods', 'kdr,sklearn', '--jobs', '1']
    assert main(options) == 0
    output = capsys.readouterr().out
    assert 'sklearn: not installed: python3 -m pip install scikit-learn' in output
    assert 'taxi: not installed: python3 -m pip install gymnasium' in output
    assert '| chain | 12 |' in output
    assert '| taxi' not in output
    assert main([*TINY, '--tasks', 'taxi']) == 1
    assert 'none of the requested packages is installed' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--tasks', 'chess'], "got 'chess'; expected some of without_gravel, with_gravel"),
        (['--methods', 'mi'], "got 'mi'; expected some of default, paper, kdr"),
        (['--first-seed', '-1'], "got '-1'; expected a whole number from 0"),
    ],
)
def test_bad_arguments_are_one_clear_sentence(arguments, message, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert message in capsys.readouterr().err


def test_a_log_that_cannot_be_read_is_one_clear_sentence(tmp_path, capsys):
    path = tmp_path / 'notes.csv'
    path.write_text('a,b\n')
    assert main([*TINY, '--tasks', 'chain', '--log', str(path)]) == 1
    assert capsys.readouterr().err.startswith(f'accuracy: {path} begins with')


def test_distractors_leave_the_task_alone_and_know_nothing_of_it():
    episodes, others = rollout_chain(400, 1), rollout_chain(400, 2)
    appended = with_distractors(episodes, others, seed=3)
    assert len(distractor_names(('a', 'b', 'c', 'd'))) == appended[0].num_channels - 4
    for episode, longer in zip(episodes, appended, strict=True):
        np.testing.assert_array_equal(longer.states[:, :4], episode.states)
        np.testing.assert_array_equal(longer.rewards, episode.rewards)
    first = np.array([e.states[0] for e in appended])
    last = np.array([e.states[-1] for e in appended])
    for samples in (first, last):
        correlation = np.corrcoef(samples.T)[:4, 4:]
        assert np.abs(correlation).max() < 0.25
    # noise: independent from step to step; a walk: its spread grows; others: those of the task
    assert abs(np.corrcoef(first[:, 4], last[:, 4])[0, 1]) < 0.25
    assert last[:, 7:10].std() / first[:, 7:10].std() == pytest.approx(np.sqrt(5), rel=0.15)
    np.testing.assert_allclose(last[:, 10:].std(axis=0), last[:, :4].std(axis=0), rtol=0.2)


def test_another_robot_whose_episode_ends_sooner_stands_still():
    episode = Episode(np.zeros((4, 1)), np.zeros(4))
    other = Episode([[5.0], [6.0]], np.zeros(2))
    (longer,) = with_distractors([episode], [other], seed=0)
    assert longer.states[:, -1].tolist() == [5, 6, 6, 6]


@pytest.mark.parametrize('name', TASKS)
def test_the_same_seed_gives_the_same_episodes_and_fewer_are_the_first(name):
    if what_is_missing(name):
        pytest.skip(what_is_missing(name))
    task = TASKS[name]
    few, many, other = task.rollout(2, 5), task.rollout(4, 5), task.rollout(2, 6)
    for a, b in zip(few, many, strict=False):
        assert a.states.tobytes() == b.states.tobytes()
        assert a.rewards.tobytes() == b.rewards.tobytes()
    assert few[0].states.tobytes() != other[0].states.tobytes()
    assert few[0].num_channels == len(task.channel_names) == len(set(task.channel_names))


def future(episodes):
    """Return states now, states next and rewards of all steps but the last."""
    return (
        np.concatenate([e.states[:-1] for e in episodes]),
        np.concatenate([e.states[1:] for e in episodes]),
        np.concatenate([e.rewards[:-1] for e in episodes]),
    )


def test_the_pole_moves_by_angle_and_angular_velocity_alone():
    pytest.importorskip('gymnasium', reason='gymnasium is not here')
    now, later, rewards = future(rollout_environment('cart_pole', 200, 1))
    assert set(rewards) == {1}
    # Near the upright the motion is linear. The push, left or right, moves the cart at once.
    push = np.sign(later[:, 1] - now[:, 1])
    causes = np.column_stack([now, push])
    weights, *_ = np.linalg.lstsq(causes, later[:, 3] - now[:, 3], rcond=None)
    assert weights[2] > 0.2
    assert weights[4] < -0.2
    assert np.abs(weights[:2]).max() < 0.02
    assert np.abs(now[:, 0]).max() < 1  # the track ends at 2.4


def test_the_pendulum_pays_and_moves_by_its_three_channels():
    pytest.importorskip('gymnasium', reason='gymnasium is not here')
    now, later, rewards = future(rollout_environment('pendulum', 50, 1))
    angle = np.arctan2(now[:, 1], now[:, 0])
    np.testing.assert_allclose(rewards, -(angle**2 + 0.1 * now[:, 2] ** 2), atol=0.005)
    torque = (later[:, 2] - now[:, 2] - 0.75 * now[:, 1]) / 0.15  # g = 10, m = l = 1, dt = 0.05
    assert np.abs(torque).max() < 2.001
    assert np.abs(np.corrcoef(torque, now[:, 0])[0, 1]) < 0.1


@pytest.mark.parametrize(('name', 'goal'), [('taxi', 20), ('frozen_lake', 1)])
def test_the_policy_of_the_tables_reaches_the_goal_more_often_than_not(name, goal):
    pytest.importorskip('gymnasium', reason='gymnasium is not here')
    episodes = rollout_environment(name, 100, 1)
    assert sum(episode.rewards[-1] == goal for episode in episodes) > 50


def test_peers_take_the_mean_over_the_steps_that_tell_something():
    episodes = [Episode([[i, 1.0], [i, i]], [i, 0.0]) for i in range(6)]
    episodes.append(Episode([[9.0, 2.0]], [1.0]))
    asked = []

    def estimate(returns, channels):
        asked.append((returns.tolist(), channels.shape))
        return np.arange(1.0, channels.shape[1] + 1)

    information = information_by_channel(episodes, estimate)
    # The second step pays nothing, whatever was seen: its return is constant.
    assert asked == [([0, 1, 2, 3, 4, 5, 1], (7, 2))]
    np.testing.assert_allclose(information, np.array([1, 2]) * 7 / 13)


@pytest.mark.parametrize('method', ['ennemi', 'sklearn'])
def test_the_peers_find_what_a_single_channel_tells(method):
    pytest.importorskip(method, reason=f'{method} is not here')
    rng = np.random.default_rng(0)
    episodes = [Episode(s, s[:, 2]) for s in rng.normal(size=(80, 2, 4))]
    ranking = rank(method, episodes, target=(2,), seed=0)
    assert ranking.channels[0] == 2
    assert ranking.scores[0] > 0.3 > max(ranking.scores[1:])
    assert (
        rank(method, episodes, target=(2,), seed=0, num_features=2).channels
        == (ranking.channels[:2])
    )


def test_the_oracle_finds_what_tells_much(capsys):
    options = ['--tasks', 'with_gravel', '--episodes', '40', '--trials', '2', '--first-seed', '0']
    assert accuracy_oracle.main([*options, '--jobs', '1']) == 0
    rows = [line.split(' | ') for line in capsys.readouterr().out.splitlines() if '| 40 |' in line]
    assert [row[2] for row in rows] == ['x', 'y', 'battery', 'gravel']
    assert rows[0][3:] == ['10.00 ± 0.00', '0 |']


def test_after_a_change_right_and_forgotten_are_counted(capsys, monkeypatch):
    change = 'gravel is taken away'
    monkeypatch.setattr(changing_task, 'CHANGES', {change: changing_task.CHANGES[change]})
    monkeypatch.setattr(changing_task, 'NEW_EPISODES', (100,))
    assert changing_task.main(['--trials', '1', '--first-seed', '0', '--jobs', '1']) == 0
    # Without any old episode left all are the same, and there is nothing to forget.
    assert f'| {change} | 100 | 100% | 100% | 100% | 0% |' in capsys.readouterr().out


def test_the_oracle_counts_what_the_direct_port_scores_higher():
    episodes = TASKS['with_gravel'].rollout(8, 3)
    steps = step_samples(
        episodes,
        gamma=0.95,
        standardize=True,
        max_time_bins=32,
        num_folds=5,
        num_centers=200,
        random_state=3,
    )
    scores = [conditional_mi(steps, (0, 1, 2, c), 'held_out', 2) for c in range(3, 14)]
    expected = sum(score > scores[0] for score in scores)
    assert expected > 0
    assert accuracy_oracle.ranked_higher('with_gravel', 8, 3)[3] == expected
