# SPDX-License-Identifier: Apache-2.0

import csv

import numpy as np
import pytest

pytest.importorskip('joblib')

from studies.accuracy.level import main
from studies.tasks.level_worlds import EPISODES_A_ROBOT, IRRELEVANT, LEVEL_WORLDS
from studies.tasks.registry import TASKS


def test_the_table_holds_the_shares_of_each_part_and_of_the_whole(tmp_path, capsys):
    log = tmp_path / 'trials.csv'
    options = ['--worlds', 'late', '--trials', '2', '--first-seed', '5', '--log', str(log)]
    assert main([*options, '--jobs', '1']) == 0
    output = capsys.readouterr().out
    with log.open(newline='') as file:
        rows = list(csv.DictReader(file))
    pvalues = np.array([row['ranking'].split() for row in rows if row['method'] == 'parts'], float)
    names = TASKS['late'].channel_names[1:]
    assert names == (*IRRELEVANT, 'other_x')
    signs, shifts = pvalues[:, : len(names)], pvalues[:, len(names) :]
    chosen = [set(row['ranking'].split()) - {'0'} for row in rows if row['method'] == 'automatic']
    assert len(chosen) == 2
    both = (signs <= 0.05) & (shifts <= 0.05)
    for part, found in (('signs', signs <= 0.05), ('shifts', shifts <= 0.05), ('both', both)):
        (line,) = (line for line in output.splitlines() if f'| late | 60 | {part} |' in line)
        cells = [cell.split(' ±')[0] for cell in line.strip('| ').split(' | ')]
        assert cells[3] == f'{found.mean():.1%}'
        by_kind = [found[:, i:j].mean() for i, j in ((0, 2), (2, 4), (4, 6), (6, 7))]
        assert cells[5:9] == [f'{share:.1%}' for share in by_kind]
        if part == 'both':
            assert cells[9] == f'{np.mean([bool(c) for c in chosen]):.1%}'
    before = log.read_bytes()
    assert main([*options, '--jobs', '1']) == 0
    assert log.read_bytes() == before


def test_irrelevant_sensors_are_what_their_kinds_say():
    episodes = TASKS['fading'].rollout(400, 1)
    states = np.stack([e.states for e in episodes])
    assert states.shape[2] == 1 + len(IRRELEVANT) + 1
    constant, slow, white = states[..., 1:3], states[..., 3:5], states[..., 5:7]
    assert np.ptp(constant, axis=1).max() == 0
    assert np.corrcoef(slow[:, 0, 0], slow[:, 9, 0])[0, 1] > 0.7
    assert abs(np.corrcoef(white[:, 0, 0], white[:, 1, 0])[0, 1]) < 0.15
    returns = np.array([e.rewards.sum() for e in episodes])
    correlations = np.corrcoef(states[:, 0].T, returns)[-1]
    assert correlations[0] > 0.7
    assert np.abs(correlations[1:-1]).max() < 0.15


def test_a_hidden_state_shows_in_part():
    hidden = np.array([e.rewards[-1] for e in TASKS['fading'].rollout(400, 1)])
    fading = np.stack([e.states[:, 0] for e in TASKS['fading'].rollout(400, 1)])
    assert abs(np.corrcoef(fading[:, -1], hidden)[0, 1]) < 0.2
    late = TASKS['late'].rollout(400, 1)
    shown, paid = np.stack([e.states[:, 0] for e in late]), [e.rewards.sum() for e in late]
    assert abs(np.corrcoef(shown[:, 0], paid)[0, 1]) < 0.15
    assert np.corrcoef(shown[:, -1], paid)[0, 1] > 0.7


@pytest.mark.parametrize('memory', [50, 200])
def test_windows_are_cut_from_one_drive_which_remembers(memory):
    episodes = TASKS[f'windows_memory_{memory}'].rollout(4000, 1)
    rewards = np.concatenate([e.rewards for e in episodes])
    assert rewards.std() == pytest.approx(1, rel=0.1)
    assert np.corrcoef(rewards[25:], rewards[:-25])[0, 1] == pytest.approx(
        np.exp(-25 / memory), abs=0.05
    )
    assert LEVEL_WORLDS[f'windows_memory_{memory}'].relevant == ()


def test_robots_of_a_fleet_have_their_own_zero_and_mean_reward():
    told, untold = TASKS['fleet'].rollout(600, 1), TASKS['fleet_without_sources'].rollout(600, 1)
    assert [e.source for e in told[:EPISODES_A_ROBOT]] == ['robot_0'] * EPISODES_A_ROBOT
    assert told[EPISODES_A_ROBOT].source == 'robot_1'
    assert {e.source for e in untold} == {''}
    zero = np.array([e.states[:, 0].mean() for e in told]).reshape(-1, EPISODES_A_ROBOT)
    paid = np.array([e.rewards.mean() for e in told]).reshape(-1, EPISODES_A_ROBOT)
    assert zero.mean(axis=1).std() == pytest.approx(1, rel=0.3)
    assert paid.mean(axis=1).std() == pytest.approx(0.5, rel=0.3)
    inside = [v - v.mean(axis=1, keepdims=True) for v in (zero, paid)]
    assert np.corrcoef(inside[0].ravel(), inside[1].ravel())[0, 1] > 0.4
