# SPDX-License-Identifier: Apache-2.0

"""What was saved is on the disk, whenever the process is killed."""

import os
import resource
import subprocess
import sys
import textwrap

import pytest
from saved_episodes import ENOUGH, NAMES, episodes, same, wait_until

from cmifs_ros.collect.episodes.file_format import Saved
from cmifs_ros.collect.episodes.file_reader import read_episodes
from cmifs_ros.collect.episodes.saver import EpisodeSaver
from cmifs_ros.core import Episode


def test_the_newest_is_saved_and_the_last_save_is_finished(tmp_path):
    path = str(tmp_path / 'x')
    saver = EpisodeSaver(path)
    sent = episodes(200)
    for count in range(1, 201):
        saver.save(Saved(NAMES, sent[:count]))
    saver.stop()
    assert len(read_episodes(path, max_episodes=999, max_bytes=10**6).episodes) == 200
    assert saver.error == ''
    assert 1 <= saver.num_saves <= 200


def test_what_was_appended_is_in_the_file_already_and_joins_the_next_one(tmp_path, monkeypatch):
    monkeypatch.setattr('cmifs_ros.collect.episodes.saver._LEAST_APPENDED', 1000)
    path, sent = str(tmp_path / 'x'), episodes(200)
    saver = EpisodeSaver(path)
    assert not saver.append(sent[0], NAMES)  # There is no file yet.
    saver.save(Saved(NAMES, sent[:1]))
    wait_until(lambda: saver.num_saves)
    for count, episode in enumerate(sent[1:], 2):
        if not saver.append(episode, NAMES):
            saver.save(Saved(NAMES, sent[:count]))
        got = read_episodes(path, max_episodes=999, max_bytes=10**6).episodes
        assert len(got) == count
        assert same(got[-1], episode)
    wait_until(lambda: saver.num_saves > 1)  # The file is written anew now and then,
    assert saver.num_saves < 20  # and seldom.
    assert not saver.append(sent[0], ('d', 'e'))  # Other channels need another file.
    saver.save(Saved(('d', 'e'), ()))
    assert saver.append(sent[0], ('d', 'e'))
    acting = Episode(sent[0].states, sent[0].rewards, [0, 1, 0, 1], 'robot 1')
    assert not saver.append(acting, ('d', 'e'), ('turn',))  # So do actions.
    saver.save(Saved(('d', 'e'), sent[:1], action_names=('turn',)))
    assert saver.append(acting, ('d', 'e'), ('turn',))
    saver.stop()
    assert saver.error == ''
    got = read_episodes(path, **ENOUGH)
    assert (got.channel_names, got.action_names) == (('d', 'e'), ('turn',))
    assert all(map(same, got.episodes, [sent[0], acting]))


def test_killed_at_any_moment_nothing_that_was_appended_is_lost(tmp_path):
    path = tmp_path / 'x'
    code = textwrap.dedent(f"""
        import numpy as np
        from cmifs_ros.core import Episode
        from cmifs_ros.collect.episodes import saver as episode_saver
        from cmifs_ros.collect.episodes.file import Saved
        episode_saver._LEAST_APPENDED = 3000
        saver, kept = episode_saver.EpisodeSaver({str(path)!r}), []
        saver.save(Saved(('a',), ()))
        while not saver.num_saves:
            pass
        while True:
            kept = (kept + [Episode(np.full((20, 1), float(len(kept))), np.zeros(20))])
            if not saver.append(kept[-1], ('a',)):
                saver.save(Saved(('a',), tuple(kept)))
            print(len(kept), flush=True)
    """)
    for attempt in range(8):
        process = subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE, text=True)
        lines = [process.stdout.readline() for _ in range(50 + 37 * attempt)]
        process.kill()
        told = int([*lines, *process.stdout][-1])
        process.wait()
        got = read_episodes(path, max_episodes=10**6, max_bytes=10**9).episodes
        assert len(got) in (told, told + 1)
        assert [e.states[0, 0] for e in got] == list(range(len(got)))
        path.unlink()


def test_a_full_disk_is_told_and_tried_again(tmp_path, monkeypatch):
    monkeypatch.setattr('cmifs_ros.collect.episodes.saver.RETRY_PERIOD', 0.05)
    path = str(tmp_path / 'x')
    saver = EpisodeSaver(path)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
        saver.save(Saved(NAMES, episodes(100)))
        wait_until(lambda: saver.error)
        assert path in saver.error
        assert 'File too large' in saver.error
        assert os.listdir(tmp_path) == ['x.lock']  # not even the temporary file
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    wait_until(lambda: saver.num_saves == 1)
    assert saver.error == ''
    saver.stop()
    assert len(read_episodes(path, **ENOUGH).episodes) == 100


def test_a_path_that_is_no_file_of_its_own_is_refused(tmp_path):
    with pytest.raises(ValueError, match='there is no folder'):
        EpisodeSaver(str(tmp_path / 'nowhere' / 'x'))
    os.mkfifo(tmp_path / 'fifo')
    for path in (str(tmp_path), '/dev/full', str(tmp_path / 'fifo')):
        with pytest.raises(ValueError, match='expected the path of a file'):
            EpisodeSaver(path)
    saver = EpisodeSaver(str(tmp_path / 'x'))
    with pytest.raises(ValueError, match='which another selector uses'):
        EpisodeSaver(str(tmp_path / 'x'))
    saver.stop()
    EpisodeSaver(str(tmp_path / 'x')).stop()
