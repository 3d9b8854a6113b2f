# SPDX-License-Identifier: Apache-2.0

import csv
import warnings
from importlib.util import find_spec

import numpy as np
import pytest

pytest.importorskip('joblib')
pytest.importorskip('sklearn', reason='scikit-learn is not here')

from studies.accuracy.targets import main
from studies.methods.conditional_importance import conditional_selection
from studies.methods.knockoffs import sequential_knockoffs
from studies.methods.recursive_forests import recursive_selection
from studies.tasks.control import rollout_control


def test_the_tables_hold_what_each_trial_found(tmp_path, capsys):
    log = tmp_path / 'trials.csv'
    options = ['--worlds', 'toy', '--trials', '1', '--first-seed', '7', '--log', str(log)]
    assert main([*options, '--jobs', '1']) == 0
    output = capsys.readouterr().out
    with log.open(newline='') as file:
        rows = list(csv.DictReader(file))

    def found(world, method):
        rankings = [r['ranking'] for r in rows if (r['scenario'], r['method']) == (world, method)]
        assert len(rankings) == 1
        return [[int(i) for i in ranking.split()] for ranking in rankings]

    def share(answers):
        return f'{sum(answers) / len(answers):.0%}'

    lines = [line[2:-2] for line in output.splitlines() if line.startswith('|')]
    lines = [[cell.split(' ±')[0].strip() for cell in line.split(' | ')] for line in lines]
    rows_of_targets = {line[2]: dict(zip(lines[0], line, strict=True)) for line in lines[2:5]}
    peers = {
        'return': ('recursive', 'knockoffs', 'conditional', 'forest'),
        'decision': ('recursive', 'knockoffs', None, 'forest'),
        'action': (None, None, 'conditional_of_action', 'forest_of_action'),
    }
    columns = (
        *('recursive extra trees, exactly', 'sequential knockoffs, exactly'),
        *('conditional importance, exactly', 'extra trees, told the number'),
    )
    is_there = {'knockoffs', 'conditional', 'conditional_of_action'}.isdisjoint
    for target, row in rows_of_targets.items():
        assert row['needed'] == 's0, s2'
        assert row['ours, exactly'] == share([set(r) == {0, 2} for r in found('toy', target)])
        for peer, column in zip(peers[target], columns, strict=True):
            count = 2 if column.endswith('told the number') else None
            if peer is None or not (find_spec('hidimstat') or is_there({peer})):
                assert row[column] == ''
            else:
                right = [set(r[:count]) == {0, 2} for r in found('toy', peer)]
                assert row[column] == share(right)
    errors = [line for line in output.splitlines() if line.startswith('| toy |')][-1]
    errors = [cell.split(' ±')[0].strip() for cell in errors.strip('|').split('|')]
    assert errors[1] == share([bool(r) for r in found('toy', 'warning')])
    assert errors[2:] == [
        share([bool(r) for r in found('toy', f'{t}_shuffled')])
        for t in ('return', 'decision', 'action')
    ]
    before = log.read_bytes()
    assert main([*options, '--jobs', '1']) == 0
    assert log.read_bytes() == before


def test_recursive_trees_follow_what_predicts_what_is_needed():
    # The reward depends on s1, which s2 predicts.
    assert set(recursive_selection(rollout_control('toy', 60, 1), seed=0)) == {0, 2}
    # It matters only with the action.
    assert recursive_selection(rollout_control('match', 60, 1), seed=0) == [0]


def test_sequential_knockoffs_follow_what_predicts_what_is_needed():
    pytest.importorskip('hidimstat', reason='hidimstat is not here')
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', UserWarning)  # Of a matrix that is nearly singular.
        assert set(sequential_knockoffs(rollout_control('toy', 60, 1), seed=0)) == {0, 2}
        assert sequential_knockoffs(rollout_control('match', 60, 1), seed=0) == [0]


def test_conditional_importance_knows_groups_and_what_is_given():
    pytest.importorskip('hidimstat', reason='hidimstat is not here')
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=(400, 5))
    target = inputs[:, 0] + inputs[:, 1] + 2 * inputs[:, 4] + 0.5 * rng.normal(size=400)
    numbers = np.repeat(np.arange(40), 10)
    # The sum of a pair, noise, and what is given only.
    assert conditional_selection(inputs, target, numbers, [(2, 3), (0, 1)], seed=0) == [1]
