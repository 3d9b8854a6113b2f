# SPDX-License-Identifier: Apache-2.0

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cmifs_ros.core.cyclic_shifts import CyclicShifts


def exchanged(lengths, sources, order, seed=0):
    """Return, of each row in each shift, the row that takes its place: shape (S, N)."""
    lengths, order = np.array(lengths), np.array(order)
    starts = np.cumsum(lengths) - lengths
    rng = np.random.default_rng(seed)
    shifts = CyclicShifts(starts, lengths, np.array(sources), order, rng)
    one_hot = np.eye(lengths.sum())
    products = shifts.products(one_hot, one_hot)
    np.testing.assert_allclose(products, products.round(), atol=1e-9)
    return products.argmax(axis=1)


@given(st.data(), st.lists(st.integers(1, 5), min_size=2, max_size=8))
def test_each_row_takes_the_place_of_one_of_the_same_step_and_source(data, lengths):
    count = len(lengths)
    sources = data.draw(st.lists(st.sampled_from('ab'), min_size=count, max_size=count))
    order = data.draw(st.permutations(range(count)))
    shifted = exchanged(lengths, sources, order)
    source = np.repeat(sources, lengths)
    step = np.concatenate([np.arange(length) for length in lengths])
    alike = (source[:, None] == source) & (step[:, None] == step)
    assert len(shifted) == count - 1
    for rows in shifted:
        assert sorted(rows) == list(range(len(rows)))
        assert np.all(alike[np.arange(len(rows)), rows])
        assert np.all((rows != np.arange(len(rows))) | (alike.sum(axis=1) == 1))


@given(st.permutations(range(6)), st.integers(1, 3))
def test_episodes_of_one_length_are_shifted_by_each_number_in_their_order(order, length):
    shifted = exchanged([length] * 6, [''] * 6, order)
    place = np.argsort(order)
    for by, rows in enumerate(shifted, start=1):
        of_episode, step = np.divmod(rows.reshape(6, length), length)
        assert np.all(step == np.arange(length))
        assert np.all(place[of_episode] == (place[:, None] + by) % 6)


def test_of_many_shifts_300_are_spread_evenly():
    shifted = exchanged([1] * 400, [''] * 400, range(400))
    by = shifted[:, 0]
    assert len(by) == 300
    assert (by[0], by[-1]) == (1, 399)
    assert set(np.diff(by)) == {1, 2}
