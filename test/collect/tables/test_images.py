# SPDX-License-Identifier: Apache-2.0

"""Images within LeRobot's tables are cameras."""

import io
import json

import numpy as np
import pytest

pytest.importorskip('pyarrow', reason='pyarrow is not here')
pytest.importorskip('PIL', reason='Pillow is not here')
import pyarrow as pa
from PIL import Image
from pyarrow import parquet

from cmifs_ros.collect.recording import episodes_of_recording

CAMERA = 'observation.images.wrist'
LENGTHS = (40, 30, 50)
BRIGHT = np.random.default_rng(0).integers(0, 200, size=sum(LENGTHS))


def cell(value, kind):
    stream = io.BytesIO()
    Image.new('RGB', (40, 20), (int(value),) * 3).save(stream, kind)
    return {'bytes': stream.getvalue(), 'path': None}


def write(folder, cells):
    """Write a data set of two files, whose rows are out of order in the first."""
    numbers = np.repeat(np.arange(3), LENGTHS)
    frames = np.concatenate([np.arange(length) for length in LENGTHS])
    order = np.concatenate([np.arange(70)[::-1], np.arange(70, 120)])
    (folder / 'data/chunk-000').mkdir(parents=True)
    for name, part in (('file-000', order[:70]), ('file-001', order[70:])):
        columns = {
            'observation.state': [[float(n)] for n in frames[part]],
            CAMERA: [cells[i] for i in part],
            'next.reward': frames[part].astype(float),
            'frame_index': frames[part],
            'episode_index': numbers[part],
        }
        parquet.write_table(pa.table(columns), folder / f'data/chunk-000/{name}.parquet')
    features = {
        'observation.state': {'dtype': 'float32', 'names': ['x']},
        CAMERA: {'dtype': 'image', 'names': ['height', 'width', 'channels']},
    }
    (folder / 'meta').mkdir()
    (folder / 'meta/info.json').write_text(json.dumps({'fps': 10, 'features': features}))
    return folder


@pytest.mark.parametrize('kind', ['PNG', 'JPEG'])
def test_an_image_is_that_of_its_row(tmp_path, kind):
    folder = write(tmp_path / 'set', [cell(value, kind) for value in BRIGHT])
    found = episodes_of_recording(folder)
    assert found.unreadable == {}
    assert len(found.channel_names) == 1 + 15
    ends = np.cumsum(LENGTHS)
    place = found.channel_names.index('images.wrist[0,0]')
    for episode, bright in zip(found.episodes, np.split(BRIGHT, ends[:-1]), strict=True):
        np.testing.assert_allclose(episode.states[:, place], bright, atol=1)
    steps = [(2, 49), (0, 3), (1, 0)]
    pictures = found.cameras['images.wrist'](steps)
    for shown, (episode, step) in zip(pictures, steps, strict=True):
        assert shown.shape == (20, 40)
        assert shown.mean() == pytest.approx(BRIGHT[(0, *ends)[episode] + step], abs=1)


@pytest.mark.parametrize(
    ('broken', 'said'),
    [
        ({'bytes': None, 'path': 'elsewhere.png'}, 'no image; expected the bytes of a JPEG or PNG'),
        ({'bytes': b'nothing', 'path': None}, 'that cannot be decoded'),
    ],
)
def test_a_row_without_a_usable_image_is_named_and_the_rest_is_read(tmp_path, broken, said):
    cells = [cell(value, 'PNG') for value in BRIGHT]
    cells[100] = broken
    found = episodes_of_recording(write(tmp_path / 'set', cells))
    assert (found.channel_names, len(found.episodes)) == (('x',), 3)
    assert found.unreadable[CAMERA].startswith('row 100 has ')
    assert said in found.unreadable[CAMERA]
