import hashlib
import json
import os
import pickle
import resource
import signal
import subprocess
import sys
import textwrap
import time
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from selections import selection, sensor

from cmifs_ros.collect.episodes import file as episode_file
from cmifs_ros.collect.episodes.file import RefusedFileError, Saved
from cmifs_ros.collect.episodes.saver import EpisodeSaver
from cmifs_ros.collect.selection_fields import fields_of
from cmifs_ros.core import Episode

NAMES = ('a', 'b')
SELECTION = selection(
    sensor('b', is_selected=True, pvalue=0.01, status='confirmed', stability=1.0),
    sensor('a', pvalue=0.8, status='rejected', redundant_with=('b',)),
    means=(0.0, 1.0, 2.0),
    spreads=(1.0, 1.0, 1.0),
    number=7,
)
ENOUGH = {'max_episodes': 100, 'max_bytes': 10**6}


def episodes(count=3, steps=4):
    return [
        Episode(np.full((steps, 2), float(n)), np.arange(float(steps)) + n) for n in range(count)
    ]


def same(one, other):
    return np.array_equal(one.states, other.states) and np.array_equal(one.rewards, other.rewards)


def wait_until(condition, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def sealed(text, data=b''):
    """Return a file with the right checksum, whatever it says."""
    content = b'cmifs_ros episodes 4\n' + text.encode() + b'\n' + data
    return content + hashlib.sha256(content).digest()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50)
@given(data=st.data())
def test_what_was_written_is_read(tmp_path, data):
    names = data.draw(
        st.lists(st.text(min_size=1, max_size=9), min_size=1, max_size=4, unique=True)
    )
    finite = st.floats(allow_nan=False, allow_infinity=False)
    sent = []
    for length in data.draw(st.lists(st.integers(1, 5), max_size=4)):
        values = data.draw(hnp.arrays(float, (length, len(names) + 1), elements=finite))
        sent.append(Episode(values[:, 1:], values[:, 0]))
    path = tmp_path / 'episodes'
    num_appended = data.draw(st.integers(0, len(sent)))
    first = sent[: len(sent) - num_appended]
    episode_file.write(path, Saved(tuple(names), first, SELECTION, 12.5))
    with path.open('ab') as file:
        file.writelines(map(episode_file.record, sent[len(first) :]))
    got = episode_file.read(path, **ENOUGH)
    assert (got.channel_names, got.selection, got.selected_at) == (tuple(names), SELECTION, 12.5)
    assert got.torn_bytes == 0
    assert len(got.episodes) == len(sent)
    assert all(map(same, got.episodes, sent))
    assert os.listdir(tmp_path) == ['episodes']


@pytest.mark.parametrize('version', [2, 3])
def test_an_older_file_is_read_without_its_selection(tmp_path, version):
    path, (sent,) = tmp_path / 'episodes', episodes(1)
    selection = {'indices': [1], 'names': ['b'], 'ranking': ['b', 'a'], 'scores': [0.5, 0.4]}
    header = {'channels': NAMES, 'lengths': [4], 'selection': selection, 'selected_at': 1.0}
    content = f'cmifs_ros episodes {version}\n{json.dumps(header)}\n'.encode()
    content += sent.states.tobytes() + sent.rewards.tobytes()
    path.write_bytes(content + hashlib.sha256(content).digest())
    found = episode_file.read(path, **ENOUGH)
    assert found.selection is None
    assert all(map(same, found.episodes, [sent]))


def test_nothing_at_all_can_be_saved_too(tmp_path):
    episode_file.write(tmp_path / 'x', Saved(None, ()))
    assert episode_file.read(tmp_path / 'x', **ENOUGH) == Saved(None, [])


@pytest.mark.parametrize('num_saved', [0, 4, 5])
def test_of_too_much_the_newest_is_read(tmp_path, num_saved):
    path, sent = tmp_path / 'x', episodes(5)
    episode_file.write(path, Saved(NAMES, sent[:num_saved]))
    with path.open('ab') as file:
        file.writelines(map(episode_file.record, sent[num_saved:]))
    for bounds in ({'max_episodes': 2, 'max_bytes': 10**6}, {'max_episodes': 9, 'max_bytes': 200}):
        got = episode_file.read(path, **bounds).episodes
        assert len(got) == 2
        assert all(map(same, got, sent[-2:]))


def test_every_truncation_and_every_changed_byte_is_noticed(tmp_path):
    path = tmp_path / 'x'
    episode_file.write(path, Saved(NAMES, episodes(2, steps=2), SELECTION, 1.0))
    whole = path.read_bytes()
    damaged = [whole[:size] for size in range(len(whole))]
    for i in range(len(whole)):
        damaged.append(whole[:i] + bytes([whole[i] ^ 1]) + whole[i + 1 :])
    for content in damaged:
        path.write_bytes(content)
        with pytest.raises(RefusedFileError):
            episode_file.read(path, **ENOUGH)


def test_an_episode_appended_in_part_is_dropped_and_told_but_a_changed_byte_refused(tmp_path):
    path, sent = tmp_path / 'x', episodes(3, steps=2)
    episode_file.write(path, Saved(NAMES, sent[:1]))
    whole = path.read_bytes()
    first, second = map(episode_file.record, sent[1:])
    for size in range(len(second)):
        path.write_bytes(whole + first + second[:size])
        got = episode_file.read(path, **ENOUGH)
        assert (len(got.episodes), got.torn_bytes) == (2, size)
    appended = first + second
    for i in range(len(appended)):
        changed = appended[:i] + bytes([appended[i] ^ 1]) + appended[i + 1 :]
        path.write_bytes(whole + changed)
        with pytest.raises(RefusedFileError, match='is corrupt'):
            episode_file.read(path, **ENOUGH)


def test_a_record_with_right_checksums_is_not_believed_either(tmp_path):
    path = tmp_path / 'x'

    def read(names, length, values):
        header = length.to_bytes(8, 'little')
        header += zlib.crc32(header).to_bytes(4, 'little')
        content = header + np.array(values).tobytes()
        episode_file.write(path, Saved(names, ()))
        with path.open('ab') as file:
            file.write(content + hashlib.sha256(content).digest())
        return episode_file.read(path, **ENOUGH)

    assert len(read(('a',), 1, [0.0, 0.0]).episodes) == 1
    for names, length, values in ((('a',), 0, []), (None, 1, [0.0]), (('a',), 1, [0.0, np.inf])):
        with pytest.raises(RefusedFileError):
            read(names, length, values)
    assert read(('a',), 2**63, [0.0, 0.0]).torn_bytes == 60  # nothing of that size is allocated


class Bomb:
    def __reduce__(self):
        return os.mkdir, ('executed',)


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        (b'', 'is no episodes file'),
        (b'%PDF-1.7 thesis', 'is no episodes file'),
        (pickle.dumps(Bomb()), 'is no episodes file'),
        (b'cmifs_ros episodes 1\n{}\n', 'is of format version 1; expected 4'),
        (b'cmifs_ros episodes 5\n', 'is of format version 5; expected 4'),
        (b'cmifs_ros episodes 2\n{"channels": []', 'is truncated'),
    ],
)
def test_other_files_are_refused_and_run_nothing(tmp_path, monkeypatch, content, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'x').write_bytes(content)
    with pytest.raises(RefusedFileError, match=message):
        episode_file.read('x', **ENOUGH)
    assert os.listdir(tmp_path) == ['x']


HEADER = {'channels': ['a'], 'lengths': [1], 'selection': None, 'selected_at': 0.0}


@pytest.mark.parametrize(
    'change',
    [
        {'channels': ['a', 'a']},
        {'channels': ['']},
        {'channels': ['a' * 257]},
        {'channels': [str(n) for n in range(5000)]},
        {'channels': 'a'},
        {'channels': [], 'lengths': [2]},
        {'lengths': [-1]},
        {'lengths': [0]},
        {'lengths': [1.0]},
        {'lengths': [10**15]},
        {'lengths': [10**400]},
        {'lengths': None},
        {'selection': {}},
        {'selection': fields_of(SELECTION) | {'indices': [10**9]}},
        {'selection': fields_of(SELECTION) | {'means': [1.0]}},
        {'selection': fields_of(selection(sensor('a')))},  # of nothing
        {'selected_at': 'now'},
    ],
)
def test_a_header_with_a_right_checksum_is_not_believed_either(tmp_path, change):
    path = tmp_path / 'x'
    path.write_bytes(sealed(json.dumps(HEADER), np.zeros(2).tobytes()))
    assert len(episode_file.read(path, **ENOUGH).episodes) == 1
    path.write_bytes(sealed(json.dumps(HEADER | change), np.zeros(2).tobytes()))
    with pytest.raises(RefusedFileError):
        episode_file.read(path, **ENOUGH)


@pytest.mark.parametrize('text', ['[' * 100_000, '"' + 'x' * 2**26, '[]', 'NaN'])
def test_odd_json_is_refused(tmp_path, text):
    (tmp_path / 'x').write_bytes(sealed(text))
    with pytest.raises(RefusedFileError):
        episode_file.read(tmp_path / 'x', **ENOUGH)


def test_values_that_are_not_finite_are_refused(tmp_path):
    (tmp_path / 'x').write_bytes(sealed(json.dumps(HEADER), np.array([0.0, np.nan]).tobytes()))
    with pytest.raises(RefusedFileError, match='expected finite'):
        episode_file.read(tmp_path / 'x', **ENOUGH)


def test_a_giant_file_is_refused_by_its_size(tmp_path):
    with (tmp_path / 'x').open('wb') as file:
        file.truncate(2**36)  # sparse
    with pytest.raises(RefusedFileError, match='expected at most'):
        episode_file.read(tmp_path / 'x', **ENOUGH)


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
    assert len(episode_file.read(tmp_path / 'x', **ENOUGH).episodes) == 3


def test_a_writer_that_is_killed_leaves_one_file_or_the_other(tmp_path):
    path = tmp_path / 'x'
    code = textwrap.dedent(f"""
        import numpy as np
        from cmifs_ros.core import Episode
        from cmifs_ros.collect.episodes import file as episode_file
        number = 0
        while True:
            number += 1
            many = [Episode(np.full((100, 2), float(number)), np.zeros(100))] * 50
            episode_file.write({str(path)!r}, episode_file.Saved(('a', 'b'), many))
    """)
    for attempt in range(8):
        process = subprocess.Popen([sys.executable, '-c', code])
        wait_until(path.exists)
        time.sleep(0.007 * attempt)  # another moment each time
        process.send_signal(signal.SIGKILL)
        process.wait()
        got = episode_file.read(path, max_episodes=100, max_bytes=10**8).episodes
        assert len(got) == 50
        assert len({e.states[0, 0] for e in got}) == 1
        path.unlink()
        assert set(os.listdir(tmp_path)) <= {'x.tmp'}


def test_the_newest_is_saved_and_the_last_save_is_finished(tmp_path):
    path = str(tmp_path / 'x')
    saver = EpisodeSaver(path)
    sent = episodes(200)
    for count in range(1, 201):
        saver.save(Saved(NAMES, sent[:count]))
    saver.stop()
    assert len(episode_file.read(path, max_episodes=999, max_bytes=10**6).episodes) == 200
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
        got = episode_file.read(path, max_episodes=999, max_bytes=10**6).episodes
        assert len(got) == count
        assert same(got[-1], episode)
    wait_until(lambda: saver.num_saves > 1)  # The file is written anew now and then,
    assert saver.num_saves < 20  # and seldom.
    assert not saver.append(sent[0], ('d', 'e'))  # Other channels need another file.
    saver.save(Saved(('d', 'e'), ()))
    assert saver.append(sent[0], ('d', 'e'))
    saver.stop()
    assert saver.error == ''
    got = episode_file.read(path, **ENOUGH)
    assert got.channel_names == ('d', 'e')
    assert list(map(len, got.episodes)) == [4]


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
        got = episode_file.read(path, max_episodes=10**6, max_bytes=10**9).episodes
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
    assert len(episode_file.read(path, **ENOUGH).episodes) == 100


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
