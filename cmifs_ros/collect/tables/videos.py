# SPDX-License-Identifier: Apache-2.0

"""Videos of a camera, frame by frame, by PyAV, which is optional: pip install av."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from cmifs_ros.collect.encoders import Encoder, thumbnail
from cmifs_ros.collect.recorded_episodes import RecordingError

#: Share of the time between two frames by which one may be away from its time: half, and rounding.
_SHARE = 0.75


class Shot(NamedTuple):
    """Where the video of an episode is: a file, and the time in it at which the episode begins."""

    file: Path
    begin: float


def encoded(
    shots: Mapping[int, Shot],
    rows: Mapping[int, np.ndarray],
    times: np.ndarray,
    encoder: Encoder,
    watch: Callable[[Iterable, int], Iterable],
) -> np.ndarray:
    """Return the encoded frame of each row of a table, shape (N, n); NaN for rows of no episode.

    A frame is encoded as it is decoded; none is kept.

    Parameters
    ----------
    shots : mapping of int to Shot
        By episode.
    rows : mapping of int to numpy.ndarray of int, shape (T,)
        The rows of each episode, in order.
    times : numpy.ndarray, shape (N,)
        The time of each row in its episode, in seconds.
    encoder : Encoder
    watch : callable
        Wraps an iterable of known length, to display progress.

    Raises
    ------
    RecordingError
        If a file cannot be read, or lacks a frame.

    """
    values = np.full((len(times), len(encoder.suffixes)), np.nan)
    by_file: dict[Path, list[int]] = {}
    for episode in sorted(rows, key=lambda episode: shots[episode]):
        by_file.setdefault(shots[episode].file, []).append(episode)

    def frames() -> Iterator[tuple[int, SimpleNamespace]]:
        for file, episodes in by_file.items():
            places = np.concatenate([rows[episode] for episode in episodes])
            begins = np.repeat([shots[e].begin for e in episodes], [len(rows[e]) for e in episodes])
            yield from zip(places, frames_at(file, times[places] + begins), strict=True)

    for place, frame in watch(frames(), sum(map(len, rows.values()))):
        values[place] = encoder.encode(frame)
    return values


def picture(shot: Shot, times: np.ndarray, step: int) -> np.ndarray:
    """Return a small picture at a step of an episode, given the times of all in seconds."""
    (frame,) = frames_at(shot.file, times[[step]] + shot.begin)
    return thumbnail(frame)


def frames_at(file: Path, times: np.ndarray) -> Iterator[SimpleNamespace]:
    """Yield the frames nearest to some ascending times in seconds, as sensor_msgs/Image in mono8.

    Raises
    ------
    RecordingError
        If PyAV is missing, or the file cannot be read or has no frame near a time.

    """
    if find_spec('av') is None:
        raise RecordingError('videos need PyAV: pip install av')
    from av import FFmpegError
    from av import open as open_video

    try:
        with open_video(str(file)) as container:
            stream = container.streams.video[0]
            stream.thread_type = 'AUTO'
            container.seek(int(max(0.0, times[0]) / stream.time_base), stream=stream)
            farthest = float(_SHARE / stream.average_rate) if stream.average_rate else np.inf
            decoded = container.decode(stream)
            last = frame = next(decoded)
            for time in times:
                while frame is not None and frame.time < time:
                    last, frame = frame, next(decoded, None)
                is_next = frame is not None and frame.time - time < time - last.time
                nearest = frame if is_next else last
                if abs(nearest.time - time) > farthest:
                    raise RecordingError(
                        f'{file} has no frame at {time:.2f} s; the nearest is at '
                        f'{nearest.time:.2f} s'
                    )
                yield _message(nearest)
    except (OSError, FFmpegError, StopIteration, IndexError, TypeError) as error:
        what = ' '.join(str(error).split())[:200] or 'it has no frame'
        raise RecordingError(f'{file} cannot be read as a video: {what}') from error


def _message(frame) -> SimpleNamespace:
    pixels = frame.to_ndarray(format='gray')
    height, width = pixels.shape
    return SimpleNamespace(
        height=height, width=width, encoding='mono8', is_bigendian=0, step=width,
        data=np.ascontiguousarray(pixels).reshape(-1),
    )  # fmt: skip
