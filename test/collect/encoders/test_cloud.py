# SPDX-License-Identifier: Apache-2.0

"""Point clouds by direction."""

import math
import struct
from array import array
from types import SimpleNamespace as Message

import pytest

from cmifs_ros.collect.encoders import Cloud


def cloud_of(rows, *, order='<', kind='f', step=20, offsets=(4, 8, 12), padding=0):
    """Return a sensor_msgs/PointCloud2 of rows of points."""
    data = b''
    for row in rows:
        for point in row:
            place = bytearray(b'\xff' * step)
            for offset, value in zip(offsets, point, strict=True):
                struct.pack_into(order + kind, place, offset, value)
            data += place
        data += b'\xff' * padding
    fields = [
        Message(name=name, offset=offset, datatype={'f': 7, 'd': 8}[kind], count=1)
        for name, offset in zip('xyz', offsets, strict=True)
    ]
    fields.insert(0, Message(name='intensity', offset=0, datatype=2, count=1))
    width = len(rows[0])
    return Message(
        height=len(rows), width=width, fields=fields, is_bigendian=order == '>',
        point_step=step, row_step=width * step + padding, data=array('B', data),
    )  # fmt: skip


POINTS = [[(3.0, 0.0, 1.0), (0.0, 2.0, 0.5)], [(-3.0, -4.0, 0.0), (5.0, 0.5, 3.0)]]


@pytest.mark.parametrize(
    'layout',
    [
        {},
        {'order': '>'},
        {'kind': 'd', 'step': 32, 'offsets': (16, 0, 8)},
        {'padding': 12},
    ],
)
def test_each_sector_has_its_nearest_point(layout):
    # Sectors of 90 degrees around x, y, -x and -y.
    found = Cloud(num_sectors=4, max_range=10.0).encode(cloud_of(POINTS, **layout))
    assert found == pytest.approx([3.0, 2.0, 10.0, 5.0])


def test_bands_of_height_are_apart():
    encoder = Cloud(num_sectors=4, max_range=4.5, heights=(0.25, 1.0, 4.0))
    assert encoder.suffixes == tuple(f'[{b},{s}]' for b in range(2) for s in range(4))
    assert encoder.encode(cloud_of(POINTS)) == [4.5, 2.0, 4.5, 4.5, 3.0, 4.5, 4.5, 4.5]
    one = Cloud(num_sectors=4, heights=(0.25, 1.0))
    assert one.suffixes == ('[0]', '[1]', '[2]', '[3]')
    assert one.encode(cloud_of(POINTS)) == [20.0, 2.0, 20.0, 20.0]


def test_lost_points_are_no_readings():
    points = [[(math.nan, 1.0, 1.0), (1.0, 1.0, math.inf), (0.0, 0.0, 0.0), (0.0, 3.0, 0.0)]]
    assert Cloud(num_sectors=2).encode(cloud_of(points)) == [3.0, 20.0]
    nothing = cloud_of(POINTS)
    nothing.height = nothing.width = nothing.row_step = 0
    nothing.data = array('B')
    assert Cloud().encode(nothing) == [20.0] * 12


def test_a_cloud_that_cannot_be_read_says_why():
    message = cloud_of(POINTS)
    message.data = message.data[:-1]
    with pytest.raises(ValueError, match='a cloud of 2 rows of 2 points with 79 bytes'):
        Cloud().encode(message)
    message = cloud_of(POINTS)
    message.fields[1].datatype = 4
    with pytest.raises(ValueError, match='fields intensity, x, y, z; expected x, y and z of the'):
        Cloud().encode(message)
