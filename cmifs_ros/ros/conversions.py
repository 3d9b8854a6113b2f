# SPDX-License-Identifier: Apache-2.0

"""Conversion between messages and plain values."""

from __future__ import annotations

import importlib
from array import array
from collections.abc import Iterable, Sequence

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, Int32MultiArray, MultiArrayDimension
from visualization_msgs.msg import Marker, MarkerArray

from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.collect.sampling.moments import SECOND
from cmifs_ros.core.channel_names import MAX_CHANNELS
from cmifs_ros.core.words import counted


def message_type(name: str) -> type:
    """Return the class of a type such as std_msgs/msg/Float32.

    Raises
    ------
    ValueError, ImportError, AttributeError
        If the name is malformed or the type is not installed.

    """
    package, kind, cls = name.split('/')
    if kind != 'msg':
        raise ValueError(f'{name!r} is not a message type such as std_msgs/msg/Float32')
    return getattr(importlib.import_module(f'{package}.msg'), cls)


def stamp_to_nanoseconds(stamp: Time) -> int:
    """Return a stamp as nanoseconds."""
    return stamp.sec * SECOND + stamp.nanosec


def stamp_from_nanoseconds(nanoseconds: int) -> Time:
    """Return nanoseconds, at least 0, as a stamp."""
    sec, nanosec = divmod(nanoseconds, SECOND)
    return Time(sec=sec, nanosec=nanosec)


def named_values(msg: JointState) -> tuple[list[str], array]:
    """Return the names and the positions of a message, not copied; their lengths may differ.

    Raises
    ------
    ValueError
        If either has more entries than a state may have channels.

    """
    names, values = msg.name, msg.position
    if len(names) > MAX_CHANNELS or len(values) > MAX_CHANNELS:
        size = max(len(names), len(values))
        raise ValueError(f'there are {size} names or positions; expected at most {MAX_CHANNELS}')
    return names, values


class FieldReader:
    """Read chosen fields of joint states; channels are called `wheel.velocity`.

    Parameters
    ----------
    fields : sequence of str
        'position', whose channels are called by the names alone, 'velocity', 'effort'.

    """

    def __init__(self, fields: Sequence[str]):
        self._fields = tuple(fields)
        self._names: list[str] | None = None
        self._channels: list[str] = []

    def channels_of(self, msg: JointState) -> tuple[list[str], array]:
        """Return the names and values of a message's channels; not copied for positions alone.

        Raises
        ------
        ValueError
            If there are too many channels, or a field and the names differ in length.

        """
        if self._fields == ('position',):
            if msg.name and not msg.position:
                others = [f for f in ('velocity', 'effort') if getattr(msg, f)]
                if others:
                    raise ValueError(
                        f'there is {" and ".join(others)} and no position: '
                        f'set fields to {",".join(others)}'
                    )
            return named_values(msg)
        if len(msg.name) * len(self._fields) > MAX_CHANNELS:
            raise ValueError(
                f'there are {counted(len(msg.name), "name")} with '
                f'{counted(len(self._fields), "field")} each; expected at most {MAX_CHANNELS} '
                'channels'
            )
        values = array('d')
        for field in self._fields:
            part = getattr(msg, field)
            if len(part) != len(msg.name):
                values_of = f'{field} has {counted(len(part), "value")}'
                raise ValueError(f'{values_of} for {counted(len(msg.name), "name")}')
            values += part
        if msg.name != self._names:
            self._names = msg.name
            self._channels = [
                name if field == 'position' else f'{name}.{field}'
                for field in self._fields
                for name in msg.name
            ]
        return self._channels, values


def named_values_to_msg(header: Header, names: Iterable[str], values: Iterable[float]):
    """Return a JointState with the given names and positions."""
    return JointState(header=header, name=list(names), position=[float(v) for v in values])


def reward_sample_to_msg(header: Header, sample: RewardSample, action: int | None) -> JointState:
    """Return a `reward` message with all its fields; an action that is not a number is left out."""
    fields = {
        'reward': sample.reward,
        **({} if action is None else {'action': action}),
        'terminated': sample.terminated,
        'truncated': sample.truncated,
        'episode': sample.episode,
        'step': sample.step,
    }
    return named_values_to_msg(header, fields, fields.values())


def indices_to_msg(indices: Sequence[int]) -> Int32MultiArray:
    """Return channel indices, in their order."""
    msg = Int32MultiArray(data=[int(i) for i in indices])
    msg.layout.dim = [MultiArrayDimension(label='channel', size=len(indices), stride=len(indices))]
    return msg


def grid_to_msg(header: Header, walls: np.ndarray, gravel: np.ndarray) -> OccupancyGrid:
    """Return the world as a map: walls 100, gravel 50, free 0.

    The cell in column c and row r, counted from 1, has its centre at x = c, y = r in metres.

    Parameters
    ----------
    header : Header
    walls, gravel : numpy.ndarray of bool, shape (columns, rows)

    """
    cells = np.where(walls, 100, np.where(gravel, 50, 0))
    msg = OccupancyGrid(header=header, data=[int(c) for c in cells.T.ravel()])
    msg.info.map_load_time = header.stamp
    msg.info.resolution = 1.0
    msg.info.width, msg.info.height = cells.shape
    msg.info.origin.position.x = msg.info.origin.position.y = 0.5
    msg.info.origin.orientation.w = 1.0
    return msg


def robot_to_msg(header: Header, column: int, row: int, battery: int) -> MarkerArray:
    """Return the robot as a sphere with its battery level written above."""
    body = Marker(header=header, ns='robot', id=0, type=Marker.SPHERE)
    text = Marker(header=header, ns='robot', id=1, type=Marker.TEXT_VIEW_FACING)
    text.text = f'battery {battery}'
    for marker, height, size in ((body, 0.5, 0.7), (text, 1.5, 0.5)):
        marker.pose.position.x, marker.pose.position.y = float(column), float(row)
        marker.pose.position.z = height
        marker.pose.orientation.w = 1.0
        marker.scale.x = marker.scale.y = marker.scale.z = size
        marker.color.r, marker.color.g, marker.color.b, marker.color.a = 0.1, 0.4, 0.9, 1.0
    return MarkerArray(markers=[body, text])
