# SPDX-License-Identifier: Apache-2.0

import csv

import numpy as np
import pytest

pytest.importorskip('sklearn', reason='scikit-learn is not here')

from cmifs_ros.sim.policy import preferred_action
from studies.learning import curves
from studies.learning.fitted_q import REGRESSORS, FittedQ
from studies.learning.worlds import Transitions, collect, returns_of


def corridor(num_steps=2000, seed=0):
    """Five cells in a row, the last one pays and ends; the second channel is noise."""
    rng = np.random.default_rng(seed)
    cells = rng.integers(0, 4, num_steps)
    actions = rng.integers(0, 2, num_steps)
    reached = np.clip(cells + 2 * actions - 1, 0, 4)
    noise = rng.normal(size=(2, num_steps))
    return Transitions(
        np.column_stack([cells, noise[0]]).astype(float),
        actions,
        (reached == 4).astype(float),
        np.column_stack([reached, noise[1]]).astype(float),
        reached == 4,
    )


@pytest.mark.parametrize('regressor', REGRESSORS)
def test_the_learned_policy_walks_to_what_pays(regressor):
    policy = FittedQ(corridor(), [0], 2, regressor, num_iterations=8)
    states = np.column_stack([np.arange(4.0), np.zeros(4)])
    assert policy.act(states).tolist() == [1, 1, 1, 1]


def test_channels_that_are_not_seen_change_nothing():
    policy = FittedQ(corridor(), [0], 2, 'nearest', num_iterations=8)
    states = np.random.default_rng(1).normal(size=(20, 2))
    moved = states + np.array([0.0, 100.0])
    assert policy.act(states).tolist() == policy.act(moved).tolist()


def test_an_action_that_was_never_taken_is_named():
    with pytest.raises(ValueError, match='action 2 was never taken in 2000 transitions'):
        FittedQ(corridor(), [0], 3, 'nearest')


@pytest.mark.parametrize('task', ['with_gravel', 'cart_pole', 'pendulum'])
def test_transitions_are_the_steps_of_the_episodes(task):
    if task != 'with_gravel':
        pytest.importorskip('gymnasium')
    episodes, transitions = collect(task, 4, seed=3)
    assert np.array_equal(np.concatenate([e.states for e in episodes]), transitions.states)
    assert np.array_equal(np.concatenate([e.rewards for e in episodes]), transitions.rewards)
    begin = 0
    for episode in episodes:  # What is reached is the state of the next step.
        reached = transitions.next_states[begin : begin + len(episode) - 1]
        assert np.array_equal(reached, episode.states[1:])
        begin += len(episode)
    again, _ = collect(task, 2, seed=3)
    assert all(np.array_equal(a.states, b.states) for a, b in zip(again, episodes[:2], strict=True))


def test_returns_are_those_of_the_policy():
    direct = returns_of(
        'without_gravel', lambda states: np.array([preferred_action(s) for s in states]), 50, 0
    )
    # From row 5 or 6 nine moves right lead to column 10; the step that enters it pays too.
    assert direct.max() == 2.0 * (20 - 8)
    upward = returns_of('without_gravel', lambda states: np.zeros(len(states), int), 50, 0)
    assert upward.tolist() == [0.0] * 50


def test_an_interrupted_study_goes_on_where_it_was(tmp_path, capsys):
    path = tmp_path / 'trials.csv'
    options = [
        *('--tasks', 'without_gravel', '--sees', 'all,relevant', '--regressors', 'nearest'),
        *('--episodes', '10', '--trials', '1', '--jobs', '1', '--out', str(path)),
    ]
    assert curves.main(options) == 0
    whole = path.read_text()
    rows = list(csv.DictReader(whole.splitlines()))
    assert [row['channels'] for row in rows] == [' '.join(map(str, range(14))), '0 1']
    lines = whole.splitlines(keepends=True)
    path.write_text(''.join(lines[:2]) + lines[2][:10])  # as a process that was killed leaves it
    capsys.readouterr()
    assert curves.main(options) == 0
    assert path.read_text().startswith(''.join(lines[:2]))
    again = list(csv.DictReader(path.read_text().splitlines()))
    assert [(r['sees'], r['return']) for r in again] == [(r['sees'], r['return']) for r in rows]
    printed = capsys.readouterr().out
    learned = ' | '.join(f'{float(row["return"]):.1f} ± 0.0' for row in rows)
    behaviour = float(rows[0]['behaviour'])
    assert f'| without_gravel | 10 | nearest | 1 | {behaviour:.1f} | {learned} |' in printed
    assert '| nearest | relevant | 2.0 |' in printed


def test_the_second_half_is_collected_by_what_was_learned():
    case = curves.Case('without_gravel', 60, 'relevant_again', 0)
    episodes, transitions, channels = curves.gather(case, 'nearest', seed=0)
    num_before = sum(map(len, episodes))
    assert (len(episodes), channels) == (30, [0, 1])
    # What was learned walks to where it pays, in more than half of the actions.
    first, later = transitions.rewards[:num_before], transitions.rewards[num_before:]
    assert later.mean() > 1.5 * first.mean()


def test_another_file_is_refused(tmp_path, capsys):
    path = tmp_path / 'other.csv'
    path.write_text('a,b\n1,2\n')
    assert curves.main(['--out', str(path)]) == 1
    assert "begins with ['a', 'b']" in capsys.readouterr().err
    assert path.read_text() == 'a,b\n1,2\n'
