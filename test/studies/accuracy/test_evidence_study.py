# SPDX-License-Identifier: Apache-2.0

import csv
from functools import lru_cache

import numpy as np
import pytest

pytest.importorskip('joblib')

from cmifs_ros.core import Episode
from cmifs_ros.core.returns import discounted_returns
from studies.accuracy.evidence import main, share_of_irrelevant
from studies.methods.linear import linear_pvalues, linear_selection
from studies.tasks.registry import TASKS
from studies.tasks.rewards import GAMMA, PAIR_SHARE, STRONG_SHARE, WEAK_SHARE


def test_the_table_holds_what_was_found_and_what_is_dispensable(tmp_path, capsys):
    log = tmp_path / 'trials.csv'
    options = [
        '--tasks',
        'one_great_penalty,faint_switches',
        '--trials',
        '2',
        '--first-seed',
        '7',
        '--log',
        str(log),
    ]
    assert main([*options, '--jobs', '1']) == 0
    output = capsys.readouterr().out
    with log.open(newline='') as file:
        rows = list(csv.DictReader(file))
    for task, episodes, method, is_shown in (
        ('one_great_penalty', '60', 'automatic', lambda found: '0' in found),
        ('faint_switches', '30', 'dispensable', lambda found: bool({'0', '1'} & set(found))),
        ('faint_switches', '100', 'dispensable', lambda found: bool({'0', '1'} & set(found))),
    ):
        found = [
            row['ranking'].split()
            for row in rows
            if (row['scenario'], row['episodes'], row['method']) == (task, episodes, method)
        ]
        assert len(found) == 2
        (line,) = (line for line in output.splitlines() if f'| {task} | {episodes} |' in line)
        assert f'| {np.mean([is_shown(f) for f in found]):.0%} ±' in line
    assert share_of_irrelevant(['a', 'x'], {'x'}, {'a', 'b', 'c', 'd'}) == 0.25


@lru_cache
def returns_and_states(task):
    """Return the returns (n, T) and the states (n, T, v) of many episodes."""
    episodes = TASKS[task].rollout(4000, 1)
    returns = np.stack([discounted_returns(e.rewards, GAMMA) for e in episodes])
    return returns, np.stack([e.states for e in episodes])


def explained(functions, returns):
    """Return the share of the variance of returns (n, T) that functions (n, T, k) explain."""
    left = 0.0
    for step in range(returns.shape[1]):
        inputs = np.column_stack([functions[:, step], np.ones(len(returns))])
        slopes, *_ = np.linalg.lstsq(inputs, returns[:, step], rcond=None)
        left += np.sum((returns[:, step] - inputs @ slopes) ** 2)
    return 1 - left / np.sum((returns - returns.mean(axis=0)) ** 2)


@pytest.mark.parametrize(
    ('task', 'functions', 'share'),
    [
        ('three_percent', lambda s: s[..., :1], STRONG_SHARE),
        ('three_percent', lambda s: s[..., 1:2], WEAK_SHARE),
        ('faint_switches', lambda s: s[..., :2], 0),
        ('faint_switches', lambda s: s[..., :1] * s[..., 1:2], PAIR_SHARE),
        ('faint_product', lambda s: s[..., :2], 0),
        ('faint_product', lambda s: s[..., :1] * s[..., 1:2], PAIR_SHARE),
    ],
)
def test_sensors_explain_the_share_that_is_said(task, functions, share):
    returns, states = returns_and_states(task)
    assert explained(functions(states), returns) == pytest.approx(share, abs=0.016)


def test_a_rare_goal_is_reached_in_four_of_a_hundred():
    assert np.mean([e.rewards[-1] > 0.5 for e in TASKS['rare_goal'].rollout(4000, 1)]) == (
        pytest.approx(0.04, abs=0.01)
    )


@pytest.mark.parametrize('factor', ['0.1', '1', '10'])
def test_the_reward_of_the_readme_ends_with_its_factor(factor):
    episodes = TASKS[f'readme_reward_{factor}'].rollout(200, 1)
    last = np.array([e.rewards[-1] for e in episodes])
    grip = np.array([e.states[:, 0].mean() for e in episodes])
    assert np.abs(last - 0.05).mean() == pytest.approx(float(factor), rel=0.2)
    assert np.mean((last > 0.05) == (grip > 0)) > 0.75


def test_the_linear_model_holds_its_level_and_finds_what_is_linear():
    rng = np.random.default_rng(0)
    pvalues = []
    for _ in range(60):
        level = rng.normal(size=(60, 1, 3))  # Constant in an episode, as is half of the reward.
        states = level + 0.1 * rng.normal(size=(60, 5, 3))
        rewards = rng.normal(size=(60, 1)) + rng.normal(size=(60, 5))
        pairs = zip(states, rewards, strict=True)
        pvalues += linear_pvalues([Episode(*pair) for pair in pairs]).tolist()
    assert np.mean(np.array(pvalues) <= 0.05) == pytest.approx(0.05, abs=0.05)
    pairs = zip(states, rewards + 2 * states[..., 1], strict=True)
    episodes = [Episode(*pair) for pair in pairs]
    assert linear_selection(episodes, [(0, 2), (1,)])[0] == 1
