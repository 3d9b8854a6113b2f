# SPDX-License-Identifier: Apache-2.0

import csv

import pytest

pytest.importorskip('joblib')
pytest.importorskip('sklearn', reason='scikit-learn is not here')

from studies.accuracy.targets import main
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

    def cells(start):
        (line,) = (line for line in output.splitlines() if line.startswith(start))
        return [cell.split(' ±')[0].strip() for cell in line.strip('|').split('|')]

    peers = {'return': 'forest', 'decision': 'forest', 'action': 'forest_of_action'}
    for target, peer in peers.items():
        row = cells(f'| toy | 60 | {target} |')
        assert row[3] == 's0, s2'
        assert row[5] == share([set(r) == {0, 2} for r in found('toy', target)])
        assert row[7] == share([set(r[:2]) == {0, 2} for r in found('toy', peer)])
    assert cells('| toy | 60 | decision |')[6] == share(
        [set(r) == {0, 2} for r in found('toy', 'recursive')]
    )
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
