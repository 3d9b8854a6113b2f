# SPDX-License-Identifier: Apache-2.0

"""What is looked at of many steps is bounded, even, and the same wherever the episodes are."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmifs_ros.core import ConditionalMISelector, Episode
from cmifs_ros.core.returns import discounted_returns
from cmifs_ros.core.samples import Samples
from cmifs_ros.core.thinning import joined, plan_of, thinned

#: Steps of the episodes.
LENGTHS = st.lists(st.integers(1, 40), min_size=1, max_size=60)


def episodes_of(lengths, seed=0):
    rng = np.random.default_rng(seed)
    return [
        Episode(
            rng.normal(size=(length, 3)), rng.normal(size=length), rng.normal(size=(length, 1)),
            source=str(i % 2),
        )
        for i, length in enumerate(lengths)
    ]  # fmt: skip


def assert_same(one, other):
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, Samples):
            assert_same(a, b)
        elif a is None or b is None:
            assert a is b
        else:
            np.testing.assert_array_equal(a, b)


@given(LENGTHS, st.integers(4, 300), st.integers(0, 3))
@settings(deadline=None)
def test_a_plan_keeps_so_many_steps_at_most_and_all_if_they_are_no_more(lengths, most, seed):
    plan = plan_of(lengths, seed, max_steps=most)
    assert len(plan.kept) == len(lengths)
    for steps, length in zip(plan.kept, lengths, strict=True):
        assert (np.diff(steps) > 0).all()
        assert not len(steps) or 0 <= steps[0] <= steps[-1] < length
    count = sum(map(len, plan.kept))
    assert count == sum(lengths) if sum(lengths) <= most else 0 < count <= most
    again = plan_of(lengths, seed, max_steps=most)
    assert all(map(np.array_equal, plan.kept, again.kept))


@given(LENGTHS, st.integers(4, 300), st.integers(1, 60))
@settings(deadline=None)
def test_parts_that_are_thinned_elsewhere_give_the_same_when_joined(lengths, most, cut):
    episodes, plan = episodes_of(lengths), plan_of(lengths, max_steps=most, with_next=True)
    whole = thinned(episodes, 0.9, plan)
    parts = [part for part in (episodes[:cut], episodes[cut:]) if part]
    plans = plan.split([len(part) for part in parts])
    assert_same(joined([thinned(p, 0.9, of) for p, of in zip(parts, plans, strict=True)]), whole)


@given(LENGTHS, st.integers(4, 300))
@settings(deadline=None)
def test_the_rows_are_those_of_the_episodes(lengths, most):
    episodes = episodes_of(lengths)
    found = thinned(episodes, 0.9, plan_of(lengths, max_steps=most, with_next=True))
    rows = found.samples
    for row, (owner, step) in enumerate(zip(rows.owner, rows.step, strict=True)):
        episode = episodes[owner]
        np.testing.assert_array_equal(rows.states[row], episode.states[step])
        assert rows.rewards[row] == episode.rewards[step]
        assert rows.returns[row] == discounted_returns(episode.rewards, 0.9)[step]
    states = np.concatenate([episode.states for episode in episodes])
    np.testing.assert_array_equal(found.ranges, [states.min(axis=0), states.max(axis=0)])
    before, after = rows.transitions()
    assert len(after) == len(before.step)
    for owner, step, state in zip(before.owner, before.step, after, strict=True):
        np.testing.assert_array_equal(episodes[owner].states[step + 1], state)


def test_each_step_has_the_same_chance():
    lengths = [20] * 150 + [7] * 100 + [100] * 10
    counts = np.zeros((len(lengths), 100))
    for seed in range(300):
        for episode, steps in enumerate(plan_of(lengths, seed, max_steps=1000).kept):
            counts[episode, steps] += 1
    shares = counts[:150, :20] / 300
    expected = 1000 / sum(lengths)
    assert shares.mean(axis=0) == pytest.approx(np.full(20, expected), rel=0.05)
    assert shares.mean(axis=1) == pytest.approx(np.full(150, expected), rel=0.2)


def test_some_of_the_episodes_are_as_if_they_had_been_thinned_alone():
    lengths = [5, 9, 3, 12, 7]
    episodes, which = episodes_of(lengths), np.array([1, 3, 4])
    some = [episodes[i] for i in which]
    alone = thinned(some, 0.9, plan_of([len(e) for e in some]))
    found = thinned(episodes, 0.9, plan_of(lengths)).only(which)
    np.testing.assert_array_equal(found.places, which)
    for name in ('samples', 'mean_returns', 'mean_states', 'ranges', 'prints', 'printed'):
        a, b = getattr(found, name), getattr(alone, name)
        assert_same(a, b) if name == 'samples' else np.testing.assert_array_equal(a, b)


def test_copies_are_left_out_and_counted():
    episodes = episodes_of([5, 6, 7])
    found = ConditionalMISelector().thin([*episodes, episodes[1], episodes[0]])
    assert (len(found), found.num_copies) == (3, 2)
    with pytest.raises(ValueError, match='all 2 episodes are identical'):
        ConditionalMISelector().thin([episodes[0]] * 2)


def test_a_channel_that_changes_in_no_step_that_is_looked_at_is_not_dispensable():
    rng, plan = np.random.default_rng(0), plan_of([100] * 40, max_steps=1000)
    states = rng.normal(size=(40, 100, 2))
    states[..., 1] = 0.0
    states[17, np.setdiff1d(np.arange(100), plan.kept[17])[0], 1] = 1.0
    episodes = thinned([Episode(s, s[:, 0] + rng.normal(size=100)) for s in states], 0.95, plan)
    said = f'flag changes in none of the {len(episodes.samples.step)} steps used, of 4000'
    with pytest.warns(UserWarning, match=f'too rare to be judged: {said}'):
        selector = ConditionalMISelector().fit(episodes, ['x', 'flag'])
    assert selector.statuses_ == ['confirmed', 'undecided']
