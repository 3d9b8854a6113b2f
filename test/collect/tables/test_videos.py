# SPDX-License-Identifier: Apache-2.0

"""Videos of LeRobot's folders, v2.1 and v3, are cameras; what cannot be read is named."""

import json
import pickle

import numpy as np
import pytest

pytest.importorskip('pyarrow', reason='pyarrow is not here')
pytest.importorskip('av', reason='PyAV is not here')
import av
import pyarrow as pa
from pyarrow import parquet

from cmifs_ros.collect.recorded_episodes import RecordingError
from cmifs_ros.collect.recording import episodes_of_recording
from cmifs_ros.collect.tables import videos

LENGTHS, FPS = (5, 8, 6), 25
CAMERA = 'observation.images.wrist'
RNG = np.random.default_rng(0)
#: How bright the left half of each frame is; the right half is black.
BRIGHT = [RNG.integers(20, 236, size=length) for length in LENGTHS]


def write_video(path, bright):
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), 'w') as container:
        stream = container.add_stream('mpeg4', rate=FPS)
        stream.width, stream.height, stream.pix_fmt = 64, 32, 'yuv420p'
        stream.bit_rate = 10**7
        for value in bright:
            pixels = np.zeros((32, 64), np.uint8)
            pixels[:, :32] = value
            frame = av.VideoFrame.from_ndarray(pixels, format='gray')
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)


def write(folder, version, missing=(), **about):
    """Write a data set with one number, and a camera; return its folder."""
    frames = np.concatenate([np.arange(length) for length in LENGTHS])
    table = pa.table({
        'observation.state': [[float(n)] for n in frames],
        'next.reward': frames.astype(float),
        'timestamp': (frames / FPS).astype(np.float32),
        'frame_index': frames,
        'episode_index': np.repeat(np.arange(len(LENGTHS)), LENGTHS),
    })  # fmt: skip
    (folder / 'data/chunk-000').mkdir(parents=True)
    parquet.write_table(table, folder / 'data/chunk-000/file-000.parquet')
    if version == 'v2.1':
        pattern = 'videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4'
        for number, bright in enumerate(BRIGHT):
            chunk = number // 2
            write_video(
                folder / f'videos/chunk-{chunk:03d}/{CAMERA}/episode_{number:06d}.mp4', bright
            )
    else:
        pattern = 'videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4'
        write_video(folder / f'videos/{CAMERA}/chunk-000/file-000.mp4', np.concatenate(BRIGHT[:2]))
        write_video(folder / f'videos/{CAMERA}/chunk-000/file-001.mp4', BRIGHT[2])
        (folder / 'meta/episodes/chunk-000').mkdir(parents=True)
        columns = {
            'episode_index': [0, 1, 2],
            f'videos/{CAMERA}/chunk_index': [0, 0, 0],
            f'videos/{CAMERA}/file_index': [0, 0, 1],
            f'videos/{CAMERA}/from_timestamp': [0.0, LENGTHS[0] / FPS, 0.0],
        }
        kept = {key: values for key, values in columns.items() if key not in missing}
        parquet.write_table(pa.table(kept), folder / 'meta/episodes/chunk-000/file-000.parquet')
    features = {
        'observation.state': {'dtype': 'float32', 'names': ['x']},
        CAMERA: {'dtype': 'video', 'names': ['height', 'width', 'channels']},
    }
    about = {'fps': FPS, 'features': features, 'chunks_size': 2, 'video_path': pattern} | about
    (folder / 'meta').mkdir(exist_ok=True)
    (folder / 'meta/info.json').write_text(json.dumps(about))
    return folder


@pytest.mark.parametrize('version', ['v2.1', 'v3.0'])
def test_a_video_is_a_camera_whose_frames_belong_to_the_rows(tmp_path, version):
    watched = []
    found = episodes_of_recording(
        write(tmp_path / 'set', version), watch=lambda frames, n: watched.append(n) or frames
    )
    assert watched == [sum(LENGTHS)]
    assert len(found.channel_names) == 1 + 15
    assert {'x', 'images.wrist[0,0]', 'images.wrist[0,1]'} <= set(found.channel_names)
    assert found.unreadable == {}
    place = found.channel_names.index('images.wrist[0,0]')
    for episode, bright in zip(found.episodes, BRIGHT, strict=True):
        # Half of the picture is bright; the codec is not exact.
        np.testing.assert_allclose(episode.states[:, place], bright / 2, atol=2)
    # For the page; recordings may be read in other processes.
    steps = [(2, 3), (0, 4), (1, 0), (1, 7)]
    shown = pickle.loads(pickle.dumps(found)).cameras['images.wrist'](steps)
    for picture, (episode, step) in zip(shown, steps, strict=True):
        assert (picture.shape, picture.dtype) == ((32, 64), np.uint8)
        assert picture[:, 4:28].mean() == pytest.approx(BRIGHT[episode][step], abs=4)
        assert picture[:, 36:].mean() < 6


def test_pictures_are_those_of_the_episodes_that_are_kept(tmp_path):
    folder = write(tmp_path / 'set', 'v2.1')
    file = folder / 'data/chunk-000/file-000.parquet'
    table = parquet.read_table(file)
    rewards = table['next.reward'].to_numpy().copy()
    rewards[2] = np.nan
    place = table.column_names.index('next.reward')
    parquet.write_table(table.set_column(place, 'next.reward', pa.array(rewards)), file)
    found = episodes_of_recording(folder)
    assert len(found.episodes) == 2
    (picture,) = found.cameras['images.wrist']([(0, 6)])
    assert picture[:, 4:28].mean() == pytest.approx(BRIGHT[1][6], abs=4)


def remove_last(folder):
    (folder / f'videos/{CAMERA}/chunk-000/file-001.mp4').unlink()


def break_last(folder):
    (folder / f'videos/{CAMERA}/chunk-000/file-001.mp4').write_bytes(b'nothing' * 100)


def shorten_first(folder):
    write_video(folder / f'videos/{CAMERA}/chunk-000/file-000.mp4', [3, 4])


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        (remove_last, r'file-001.mp4 cannot be read as a video: .*No such file'),
        (break_last, r'file-001.mp4 cannot be read as a video: .*Invalid data'),
        (shorten_first, r'file-000.mp4 has no frame at 0.08 s; the nearest is at 0.04 s'),
    ],
)
def test_a_video_that_cannot_be_read_is_named_and_the_rest_is_read(tmp_path, change, said):
    folder = write(tmp_path / 'set', 'v3.0')
    change(folder)
    found = episodes_of_recording(folder)
    assert (found.channel_names, len(found.episodes)) == (('x',), 3)
    assert found.cameras == {}
    with pytest.raises(AssertionError, match=said):
        raise AssertionError(found.unreadable[CAMERA])


@pytest.mark.parametrize(
    ('version', 'options', 'said'),
    [
        (
            'v3.0',
            {'missing': [f'videos/{CAMERA}/file_index']},
            f'no column videos/{CAMERA}/file_index',
        ),
        ('v2.1', {'video_path': 'videos/{x}.mp4'}, "is 'videos/{x}.mp4', which cannot be"),
        ('v2.1', {'video_path': None}, 'has no video_path'),
    ],
)
def test_metadata_that_does_not_say_where_a_video_is_is_told(tmp_path, version, options, said):
    found = episodes_of_recording(write(tmp_path / 'set', version, **options))
    assert found.channel_names == ('x',)
    assert said in found.unreadable[CAMERA]


def test_without_pyav_the_way_to_it_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(videos, 'find_spec', lambda name: None)
    folder = write(tmp_path / 'set', 'v2.1')
    assert episodes_of_recording(folder).unreadable == {CAMERA: 'videos need PyAV: pip install av'}
    file = folder / 'data/chunk-000/file-000.parquet'
    parquet.write_table(parquet.read_table(file).drop_columns(['observation.state']), file)
    with pytest.raises(RecordingError, match='has no states: videos need PyAV: pip install av'):
        episodes_of_recording(folder)
