# SPDX-License-Identifier: Apache-2.0

"""A file is there whole, or as it was before."""

import os
import signal
import subprocess
import sys
import textwrap
import time

from saved_episodes import ENOUGH, NAMES, episodes, wait_until

from cmifs_ros.collect.episodes import file as episode_file
from cmifs_ros.collect.episodes.file_format import Saved
from cmifs_ros.collect.episodes.file_reader import read_episodes


def test_asides_do_not_overwrite_each_other(tmp_path):
    for content in 'abc':
        (tmp_path / 'x').write_text(content)
        episode_file.set_aside(tmp_path / 'x')
    kept = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert kept == {'x.refused': 'a', 'x.refused-1': 'b', 'x.refused-2': 'c'}


def test_links_put_in_the_way_are_not_followed(tmp_path):
    treasure = tmp_path / 'treasure'
    treasure.write_text('gold')
    for name in ('x', 'x.tmp'):
        (tmp_path / name).symlink_to(treasure)
    episode_file.write(tmp_path / 'x', Saved(NAMES, episodes()))
    assert treasure.read_text() == 'gold'
    assert len(read_episodes(tmp_path / 'x', **ENOUGH).episodes) == 3


def test_a_writer_that_is_killed_leaves_one_file_or_the_other(tmp_path):
    path = tmp_path / 'x'
    code = textwrap.dedent(f"""
        import numpy as np
        from cmifs_ros.core import Episode
        from cmifs_ros.collect.episodes import file as episode_file
        from cmifs_ros.collect.episodes.file_format import Saved
        number = 0
        while True:
            number += 1
            many = [Episode(np.full((100, 2), float(number)), np.zeros(100))] * 50
            episode_file.write({str(path)!r}, Saved(('a', 'b'), many))
    """)
    for attempt in range(8):
        process = subprocess.Popen([sys.executable, '-c', code])
        wait_until(path.exists)
        time.sleep(0.007 * attempt)  # another moment each time
        process.send_signal(signal.SIGKILL)
        process.wait()
        got = read_episodes(path, max_episodes=100, max_bytes=10**8).episodes
        assert len(got) == 50
        assert len({e.states[0, 0] for e in got}) == 1
        path.unlink()
        assert set(os.listdir(tmp_path)) <= {'x.tmp'}
