# SPDX-License-Identifier: Apache-2.0

"""Requests for selections: what remains of them."""

import gc
import time
import weakref

import pytest
from slow_episodes import SLOW_NAMES, slow_episodes

from cmifs_ros.ros.selection_queue import Job, SelectionQueue


def until(condition):
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize('way', ['cancelled', 'finished', 'timed out'])
def test_no_episode_is_kept_after_its_selection(way):
    episodes = slow_episodes(4 if way == 'finished' else 200)
    kept = [weakref.ref(episode) for episode in episodes]
    outcomes = []

    def make_job(cause):
        arguments = (tuple(episodes), SLOW_NAMES, 'conditional_mi', {}, {})
        return Job(1, 0, cause, arguments)

    queue = SelectionQueue(
        make_job,
        lambda: 1,
        lambda outcome: outcome,
        timeout=0.05 if way == 'timed out' else 0,
    )
    try:
        queue.request('test', lambda outcome: outcomes.append(outcome.error))
        assert queue.busy
        if way == 'cancelled':
            assert queue.cancel()
        until(lambda: queue.poll() or outcomes)
        assert ('' in outcomes) == (way == 'finished')
        episodes.clear()
        until(lambda: gc.collect() >= 0 and not any(episode() for episode in kept))
    finally:
        queue.stop()


def test_an_error_without_a_text_is_no_success():
    outcomes = []
    # Not one argument fits: a TypeError, whose name is part of the reason.
    queue = SelectionQueue(
        lambda cause: Job(1, 0, cause, ()), lambda: 1, lambda one: one, timeout=0
    )
    try:
        queue.request('test', lambda outcome: outcomes.append(outcome.error))
        until(lambda: queue.poll() or outcomes)
    finally:
        queue.stop()
    assert outcomes[0].startswith('TypeError(')
