# SPDX-License-Identifier: Apache-2.0

"""A selection needs actions of all episodes, or of none."""

import numpy as np
import pytest

from cmifs_ros.collect.episodes.same_actions import with_same_actions
from cmifs_ros.core import Episode


def episodes(with_actions, without):
    return [
        Episode([[float(i)]], [0.0], [[1.0, 0.0]] if i < with_actions else None, 'robot 1')
        for i in range(with_actions + without)
    ]


@pytest.mark.parametrize('counts', [(3, 0), (0, 3)])
def test_where_all_are_alike_nothing_is_done(counts):
    sent = episodes(*counts)
    assert with_same_actions(sent) == (sent, '')


def test_where_most_have_actions_the_others_are_left_out():
    sent = episodes(5, 2)
    found, note = with_same_actions(sent, 5)
    assert found == sent[:5]
    assert note == '5 of 7 episodes have an action at every step: the others are not used'


@pytest.mark.parametrize(('counts', 'least'), [((2, 5), 2), ((5, 2), 6)])
def test_else_all_do_without_and_lose_nothing_else(counts, least):
    sent = episodes(*counts)
    found, note = with_same_actions(sent, least)
    assert note.endswith('7 episodes have an action at every step: actions are not used')
    for episode, expected in zip(found, sent, strict=True):
        assert episode.actions.shape == (1, 0)
        assert episode.source == 'robot 1'
        np.testing.assert_array_equal(episode.states, expected.states)
