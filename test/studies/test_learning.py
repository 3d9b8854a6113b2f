# SPDX-License-Identifier: Apache-2.0

import csv

import numpy as np
import pytest

pytest.importorskip('sklearn', reason='scikit-learn is not here')

from cmifs_ros.sim.policy import preferred_action
from studies.learning import ablation, curves
from studies.learning.fitted_q import REGRESSORS, FittedQ
from studies.learning.worlds import (
    LEARNING_TASKS,
    Transitions,
    episodes_of,
    record,
    returns_of,
    transitions_of,
)


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


@pytest.mark.parametrize('task', ['with_gravel', 'stakes', 'cart_pole', 'pendulum'])
def test_transitions_are_the_steps_of_the_episodes(task):
    if task in {'cart_pole', 'pendulum'}:
        pytest.importorskip('gymnasium')
    recordings = record(task, 4, seed=3)
    episodes, transitions = episodes_of(task, recordings), transitions_of(task, recordings)
    assert np.array_equal(np.concatenate([e.states for e in episodes]), transitions.states)
    assert np.array_equal(np.concatenate([e.rewards for e in episodes]), transitions.rewards)
    actions = np.concatenate([e.actions for e in episodes])
    values = LEARNING_TASKS[task].actions
    if LEARNING_TASKS[task].is_categorical:
        assert np.array_equal(actions, np.eye(len(values))[transitions.actions])
    else:
        assert np.array_equal(actions[:, 0], np.array(values)[transitions.actions])
    begin = 0
    for episode in episodes:  # What is reached is the state of the next step.
        end = begin + len(episode)
        assert np.array_equal(transitions.next_states[begin : end - 1], episode.states[1:])
        is_short = len(episode) < LEARNING_TASKS[task].num_steps
        assert transitions.terminated[begin:end].tolist() == [False] * (end - begin - 1) + [
            is_short
        ]
        begin = end
    again = episodes_of(task, record(task, 2, seed=3))
    assert all(np.array_equal(a.states, b.states) for a, b in zip(again, episodes[:2], strict=True))


def test_a_frozen_channel_shows_one_value_to_who_acts_and_changes_nothing_else():
    seen = []

    def act(channels, rng):
        seen.append(channels)
        return rng.integers(2)

    (whole,), (frozen,) = record('match', 1, 5, act), record('match', 1, 5, act, {0: 7.0})
    seen, seen_frozen = np.array(seen[:12]), np.array(seen[12:])
    assert np.array_equal(seen, whole.states[:-1])
    assert set(seen_frozen[:, 0]) == {7.0}
    assert np.array_equal(seen_frozen[:, 1:], seen[:, 1:])
    assert np.array_equal(frozen.states, whole.states)
    assert np.array_equal(frozen.rewards, whole.rewards)


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
        *('--tasks', 'match', '--selected-by', 'all,return,needed', '--regressors', 'nearest'),
        *('--episodes', '40', '--trials', '1', '--jobs', '1', '--out', str(path)),
    ]
    assert curves.main(options) == 0
    whole = path.read_text()
    rows = list(csv.DictReader(whole.splitlines()))
    assert [row['channels'] for row in rows] == ['0 1 2 3 4 5', '0', '0']
    lines = whole.splitlines(keepends=True)
    path.write_text(''.join(lines[:2]) + lines[2][:10])  # as a process that was killed leaves it
    capsys.readouterr()
    assert curves.main(options) == 0
    assert path.read_text() == whole
    printed = capsys.readouterr().out
    learned = ' | '.join(f'{float(row["return"]):.1f} ± 0.0' for row in rows)
    behaviour = float(rows[0]['behaviour'])
    assert f'| match | 40 | nearest | 1 | {behaviour:.1f} | {learned} |' in printed
    assert '| match | 40 | hue | hue 100% |  |  |' in printed


def test_where_nothing_is_selected_the_learner_sees_everything(monkeypatch):
    monkeypatch.setattr(curves, 'choose', lambda case, episodes: [])
    ((*_, channels, _, blind),) = curves.run_case(
        curves.Case('match', 40, 'return', 0), ['nearest']
    )
    monkeypatch.undo()
    ((*_, on_all),) = curves.run_case(curves.Case('match', 40, 'all', 0), ['nearest'])
    assert (channels, blind) == ('', on_all)


def test_what_the_controller_looks_at_is_missed_and_nothing_else(tmp_path, capsys):
    path = tmp_path / 'trials.csv'
    options = ['--tasks', 'match', '--trials', '1', '--jobs', '1', '--out', str(path)]
    assert ablation.main(options) == 0
    rows = list(csv.DictReader(path.read_text().splitlines()))
    hue, *noise = rows
    assert (hue['channel'], hue['action'], len(noise)) == ('hue', 'confirmed', 5)
    # By one of two kinds every second piece is put into the right bin.
    assert float(hue['frozen']) == pytest.approx(6, abs=0.5)
    assert float(hue['intact']) > 11
    assert [(row['frozen'], float(row['error'])) for row in noise] == [(hue['intact'], 0)] * 5
    unseen = sum(row['action'] == 'dispensable' for row in noise)
    intact, frozen = (f'{float(hue[key]):.1f}' for key in ('intact', 'frozen'))
    line = f'| match | action | {intact} | 0 of 1 | {frozen} |'
    printed = capsys.readouterr().out
    assert line in printed
    assert printed.partition(line)[2].splitlines()[0].endswith(f'{unseen} of {unseen} | {intact} |')
    before = path.read_text()
    assert ablation.main(options) == 0
    assert path.read_text() == before


def test_another_file_is_refused(tmp_path, capsys):
    path = tmp_path / 'other.csv'
    path.write_text('a,b\n1,2\n')
    assert curves.main(['--out', str(path)]) == 1
    assert "begins with ['a', 'b']" in capsys.readouterr().err
    assert path.read_text() == 'a,b\n1,2\n'
