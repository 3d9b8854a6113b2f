# SPDX-License-Identifier: Apache-2.0

"""The metadata of LeRobot's folders (v2.1 and v3): columns, their names, and videos."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from cmifs_ros.collect.recorded_episodes import RecordingError

from . import arrow
from .videos import Shot

#: Where a data set keeps the names of its numbers, its tables, and in v3 the episodes' videos.
INFO, DATA, _EPISODES = Path('meta/info.json'), Path('data'), Path('meta/episodes')


class Info(NamedTuple):
    """The metadata of a data set.

    Attributes
    ----------
    features : dict
        By column, its `dtype` and `names`.
    step_seconds : float
        NaN if unknown.
    folder : pathlib.Path
    video_path : str
        Pattern of the files of videos in the folder; empty without any.
    chunk_size : int
        Number of episodes in a folder of videos, in v2.1.

    """

    features: Mapping[str, dict] = {}
    step_seconds: float = float('nan')
    folder: Path = Path()
    video_path: str = ''
    chunk_size: int = 1000

    def columns(self, *kinds: str) -> list[str]:
        """Return the columns of some `dtype`."""
        return [column for column, said in self.features.items() if said.get('dtype') in kinds]

    def shots(self, column: str, episodes: Iterable[int]) -> dict[int, Shot]:
        """Return where the videos of a column are; raise RecordingError if it is not told."""
        if not self.video_path:
            raise RecordingError(f'{self.folder / INFO} has no video_path')
        parts: dict[int, dict] = {
            episode: {'episode_index': episode, 'episode_chunk': episode // self.chunk_size}
            for episode in episodes
        }
        begins = dict.fromkeys(parts, 0.0)
        if (self.folder / _EPISODES).exists():  # v3: a file has many episodes
            names = ('chunk_index', 'file_index', 'from_timestamp')
            wanted = ['episode_index', *(f'videos/{column}/{name}' for name in names)]
            table = arrow.joined(
                self.folder, map(arrow.read, arrow.files_in(self.folder / _EPISODES))
            )
            if missing := [name for name in wanted if name not in table.column_names]:
                raise RecordingError(f'{self.folder / _EPISODES} has no column {missing[0]}')
            rows = zip(*(table[name].to_pylist() for name in wanted), strict=True)
            for episode, chunk, file, begin in rows:
                if episode in parts:
                    parts[episode] |= {'chunk_index': chunk, 'file_index': file}
                    begins[episode] = begin
        try:
            return {
                episode: Shot(
                    self.folder / self.video_path.format(video_key=column, **part), begins[episode]
                )
                for episode, part in parts.items()
            }
        except (KeyError, IndexError, ValueError, AttributeError, TypeError) as error:
            raise RecordingError(
                f'video_path in {self.folder / INFO} is {self.video_path[:200]!r}, which cannot be '
                f'filled in ({type(error).__name__}: {error})'
            ) from error


def read_info(folder: Path) -> Info:
    """Read a data set's `INFO`; raise RecordingError if it is invalid."""
    try:
        about = json.loads((folder / INFO).read_text())
        return Info(
            dict(about['features']), 1 / about['fps'] if about.get('fps') else float('nan'), folder,
            str(about.get('video_path') or ''), int(about.get('chunks_size') or 1000),
        )  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RecordingError(
            f'{folder / INFO} cannot be read ({type(error).__name__}: {error}); expected the file '
            'that LeRobot writes, with features'
        ) from error
