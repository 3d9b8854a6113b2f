# SPDX-License-Identifier: Apache-2.0

"""What was written is read, and nothing else is believed."""

import hashlib
import json
import os
import pickle
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from saved_episodes import ENOUGH, NAMES, SELECTION, episodes, same
from selections import selection, sensor

from cmifs_ros.collect.episodes import RefusedFileError, Saved, read_episodes
from cmifs_ros.collect.episodes import file as episode_file
from cmifs_ros.collect.selection_fields import fields_of
from cmifs_ros.core import Episode


def sealed(text, data=b''):
    """Return a file with the right checksum, whatever it says."""
    content = b'cmifs_ros episodes 6\n' + text.encode() + b'\n' + data
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
        values = data.draw(hnp.arrays(float, (length, len(names) + 3), elements=finite))
        # Some episodes have no actions.
        actions = values[:, :2] if data.draw(st.booleans()) else None
        source = data.draw(st.sampled_from(['', 'robot 1', 'Zoë/\udcff']))
        sent.append(Episode(values[:, 3:], values[:, 2], actions, source))
    path = tmp_path / 'episodes'
    num_appended = data.draw(st.integers(0, len(sent)))
    first = sent[: len(sent) - num_appended]
    actions = ('drive', 'turn')
    episode_file.write(
        path, Saved(tuple(names), first, SELECTION, 12.5, action_names=actions, renewals=3.25)
    )
    with path.open('ab') as file:
        for number, episode in enumerate(sent[len(first) :], 1):
            file.write(episode_file.record(episode, 3.25 + number / 100))
    got = read_episodes(path, **ENOUGH)
    assert (got.channel_names, got.selection, got.selected_at) == (tuple(names), SELECTION, 12.5)
    assert (got.action_names, got.torn_bytes) == (('drive', 'turn'), 0)
    assert got.renewals == 3.25 + num_appended / 100
    assert len(got.episodes) == len(sent)
    assert all(map(same, got.episodes, sent))
    assert os.listdir(tmp_path) == ['episodes']


@pytest.mark.parametrize('version', [2, 3, 4])
def test_an_older_file_is_read_without_its_selection(tmp_path, version):
    path, (first, second) = tmp_path / 'episodes', episodes(2)
    selection = {'indices': [1], 'names': ['b'], 'ranking': ['b', 'a'], 'scores': [0.5, 0.4]}
    header = {'channels': NAMES, 'lengths': [4], 'selection': selection, 'selected_at': 1.0}
    whole = f'cmifs_ros episodes {version}\n{json.dumps(header)}\n'.encode()
    whole += first.states.tobytes() + first.rewards.tobytes()
    record = (4).to_bytes(8, 'little')
    record += zlib.crc32(record).to_bytes(4, 'little')
    record += second.states.tobytes() + second.rewards.tobytes()
    path.write_bytes(b''.join(part + hashlib.sha256(part).digest() for part in (whole, record)))
    found = read_episodes(path, **ENOUGH)
    assert (found.selection, found.action_names, found.torn_bytes) == (None, (), 0)
    assert len(found.episodes) == 2
    assert all(map(same, found.episodes, [first, second]))


def test_a_file_from_before_the_renewals_is_read_with_its_selection(tmp_path):
    path, (first, second) = tmp_path / 'episodes', episodes(2)
    fields = fields_of(SELECTION) | {'means': SELECTION.means, 'spreads': SELECTION.spreads}
    header = {
        'channels': NAMES, 'actions': [], 'sources': ['r'], 'episodes': [[4, 0, 0]],
        'selection': fields, 'selected_at': 1.0,
    }  # fmt: skip
    whole = f'cmifs_ros episodes 5\n{json.dumps(header)}\n'.encode()
    whole += first.states.tobytes() + first.rewards.tobytes()
    record = (4).to_bytes(8, 'little') + (0).to_bytes(4, 'little') + (1).to_bytes(4, 'little')
    record += zlib.crc32(record).to_bytes(4, 'little') + b'r'
    record += second.states.tobytes() + second.rewards.tobytes()
    path.write_bytes(b''.join(part + hashlib.sha256(part).digest() for part in (whole, record)))
    found = read_episodes(path, **ENOUGH)
    assert (found.selection, found.torn_bytes, found.renewals) == (SELECTION, 0, 0)
    assert all(map(same, found.episodes, [replace(e, source='r') for e in (first, second)]))


def test_a_selection_in_an_older_form_is_not_read_but_the_episodes_are(tmp_path):
    path = tmp_path / 'episodes'
    episode_file.write(path, Saved(NAMES, episodes(1), SELECTION, 1.0))
    magic, header, rest = path.read_bytes().split(b'\n', 2)
    said = json.loads(header)
    said['selection']['version'] = 1
    content = magic + b'\n' + json.dumps(said).encode() + b'\n' + rest[:-32]
    path.write_bytes(content + hashlib.sha256(content).digest())
    found = read_episodes(path, **ENOUGH)
    assert found.selection is None
    assert all(map(same, found.episodes, episodes(1)))


def test_nothing_at_all_can_be_saved_too(tmp_path):
    episode_file.write(tmp_path / 'x', Saved(None, ()))
    assert read_episodes(tmp_path / 'x', **ENOUGH) == Saved(None, [])


def test_without_bounds_all_is_read_and_the_path_may_begin_with_the_home_folder(
    tmp_path, monkeypatch
):
    monkeypatch.setenv('HOME', str(tmp_path))
    sent = episodes(150)
    episode_file.write(tmp_path / 'saved', Saved(NAMES, sent, SELECTION, 12.5))
    found = read_episodes('~/saved')
    assert (found.channel_names, found.selection) == (NAMES, SELECTION)
    assert len(found.episodes) == 150
    assert all(map(same, found.episodes, sent))
    (tmp_path / 'saved').write_text('no episodes')
    with pytest.raises(ValueError, match=r'^~/saved is not an episodes file'):
        read_episodes('~/saved')


@pytest.mark.parametrize('num_saved', [0, 4, 5])
def test_of_too_much_the_newest_is_read(tmp_path, num_saved):
    path, sent = tmp_path / 'x', episodes(5)
    episode_file.write(path, Saved(NAMES, sent[:num_saved]))
    with path.open('ab') as file:
        file.writelines(map(episode_file.record, sent[num_saved:]))
    for bounds in ({'max_episodes': 2, 'max_bytes': 10**6}, {'max_episodes': 9, 'max_bytes': 200}):
        got = read_episodes(path, **bounds).episodes
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
            read_episodes(path, **ENOUGH)


def test_an_episode_appended_in_part_is_dropped_and_told_but_a_changed_byte_refused(tmp_path):
    path, sent = tmp_path / 'x', episodes(3, steps=2)
    episode_file.write(path, Saved(NAMES, sent[:1]))
    whole = path.read_bytes()
    first, second = map(episode_file.record, sent[1:])
    for size in range(len(second)):
        path.write_bytes(whole + first + second[:size])
        got = read_episodes(path, **ENOUGH)
        assert (len(got.episodes), got.torn_bytes) == (2, size)
    appended = first + second
    for i in range(len(appended)):
        changed = appended[:i] + bytes([appended[i] ^ 1]) + appended[i + 1 :]
        path.write_bytes(whole + changed)
        with pytest.raises(RefusedFileError, match='is corrupt'):
            read_episodes(path, **ENOUGH)


def test_a_record_with_right_checksums_is_not_believed_either(tmp_path):
    path = tmp_path / 'x'

    def read(names, length, values, renewals=0.0):
        header = length.to_bytes(8, 'little') + bytes(8) + np.float64(renewals).tobytes()
        header += zlib.crc32(header).to_bytes(4, 'little')
        content = header + np.array(values).tobytes()
        episode_file.write(path, Saved(names, ()))
        with path.open('ab') as file:
            file.write(content + hashlib.sha256(content).digest())
        return read_episodes(path, **ENOUGH)

    assert len(read(('a',), 1, [0.0, 0.0]).episodes) == 1
    for names, length, values in ((('a',), 0, []), (None, 1, [0.0]), (('a',), 1, [0.0, np.inf])):
        with pytest.raises(RefusedFileError):
            read(names, length, values)
    for renewals in (-1.0, np.inf, np.nan):
        with pytest.raises(RefusedFileError):
            read(('a',), 1, [0.0, 0.0], renewals)
    assert read(('a',), 2**63, [0.0, 0.0]).torn_bytes == 76  # nothing of that size is allocated


class Bomb:
    def __reduce__(self):
        return os.mkdir, ('executed',)


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        (b'', 'is not an episodes file'),
        (b'%PDF-1.7 thesis', 'is not an episodes file'),
        (pickle.dumps(Bomb()), 'is not an episodes file'),
        (b'cmifs_ros episodes 1\n{}\n', 'is of format version 1; expected 6'),
        (b'cmifs_ros episodes 7\n', 'is of format version 7; expected 6'),
        (b'cmifs_ros episodes 2\n{"channels": []', 'is truncated'),
    ],
)
def test_other_files_are_refused_and_run_nothing(tmp_path, monkeypatch, content, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'x').write_bytes(content)
    with pytest.raises(RefusedFileError, match=message):
        read_episodes('x', **ENOUGH)
    assert os.listdir(tmp_path) == ['x']


HEADER = {
    'channels': ['a'], 'actions': [], 'sources': [''], 'episodes': [[1, 0, 0]],
    'renewals': 0.0, 'selection': None, 'selected_at': 0.0,
}  # fmt: skip


@pytest.mark.parametrize(
    'change',
    [
        {'channels': ['a', 'a']},
        {'channels': ['']},
        {'channels': ['a' * 257]},
        {'channels': [str(n) for n in range(5000)]},
        {'channels': 'a'},
        {'channels': [], 'episodes': [[2, 0, 0]]},
        {'episodes': [[-1, 0, 0]]},
        {'episodes': [[0, 0, 0]]},
        {'episodes': [[1.0, 0, 0]]},
        {'episodes': [[10**15, 0, 0]]},
        {'episodes': [[10**400, 0, 0]]},
        {'episodes': [[1, 1, 0]]},
        {'episodes': [[1, 0, 1]]},
        {'episodes': [[1, 0]]},
        {'episodes': [1]},
        {'episodes': None},
        {'sources': [1]},
        {'actions': ['b', 'b']},
        {'selection': {}},
        {'selection': fields_of(SELECTION) | {'indices': [10**9]}},
        {'selection': fields_of(SELECTION) | {'means': [1.0]}},
        {'selection': fields_of(selection(sensor('a')))},  # of nothing
        {'selected_at': 'now'},
        {'renewals': None},
        {'renewals': -1.0},
        {'renewals': float('inf')},
    ],
)
def test_a_header_with_a_right_checksum_is_not_believed_either(tmp_path, change):
    path = tmp_path / 'x'
    path.write_bytes(sealed(json.dumps(HEADER), np.zeros(2).tobytes()))
    assert len(read_episodes(path, **ENOUGH).episodes) == 1
    path.write_bytes(sealed(json.dumps(HEADER | change), np.zeros(2).tobytes()))
    with pytest.raises(RefusedFileError):
        read_episodes(path, **ENOUGH)


@pytest.mark.parametrize('text', ['[' * 100_000, '"' + 'x' * 2**26, '[]', 'NaN'])
def test_odd_json_is_refused(tmp_path, text):
    (tmp_path / 'x').write_bytes(sealed(text))
    with pytest.raises(RefusedFileError):
        read_episodes(tmp_path / 'x', **ENOUGH)


def test_values_that_are_not_finite_are_refused(tmp_path):
    (tmp_path / 'x').write_bytes(sealed(json.dumps(HEADER), np.array([0.0, np.nan]).tobytes()))
    with pytest.raises(RefusedFileError, match='expected finite'):
        read_episodes(tmp_path / 'x', **ENOUGH)


def test_a_giant_file_is_refused_by_its_size(tmp_path):
    with (tmp_path / 'x').open('wb') as file:
        file.truncate(2**36)  # sparse
    with pytest.raises(RefusedFileError, match='expected at most'):
        read_episodes(tmp_path / 'x', **ENOUGH)
