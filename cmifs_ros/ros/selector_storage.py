# SPDX-License-Identifier: Apache-2.0

"""The file that keeps the selector's episodes and its selection over a restart."""

from __future__ import annotations

import os

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from cmifs_ros.collect.episodes import file as episode_file
from cmifs_ros.collect.episodes.file_format import Saved
from cmifs_ros.collect.episodes.file_reader import RefusedFileError, read_episodes
from cmifs_ros.collect.episodes.saver import EpisodeSaver
from cmifs_ros.core import Episode
from cmifs_ros.core.words import counted, listed

from . import diagnostics


class SelectorStorage:
    """Restore the last run from its file, and keep the file up to date.

    An unusable file is renamed, not deleted.

    Parameters
    ----------
    node : rclpy.node.Node
    path : str

    Raises
    ------
    ValueError
        If the path cannot be used for a file.

    """

    def __init__(self, node: Node, path: str):
        self._node, self._path = node, os.path.abspath(os.path.expanduser(path))
        self._saver: EpisodeSaver | None = EpisodeSaver(self._path)
        self._error = self._logged_error = ''

    def restore(self, max_episodes: int, max_bytes: int) -> Saved | None:
        """Return what the last run saved, or None if nothing usable."""
        path = self._path
        try:
            saved = read_episodes(path, max_episodes, max_bytes)
        except FileNotFoundError:
            self.save(Saved(None, ()))  # A disk that is not writable is reported now.
            return None
        except (OSError, RefusedFileError) as error:
            reason = f'{path}: {error.strerror}' if isinstance(error, OSError) else error
            try:
                aside = f'is kept as {episode_file.set_aside(path)}'
            except OSError as failure:  # It must not be overwritten either.
                self.stop()
                self._saver = None
                aside = f'cannot be renamed ({failure.strerror}), so nothing is saved'
            self._error = f'{reason}; it {aside}; the selector starts empty'
            self._log_error()
            return None
        names = saved.selection.names if saved.selection is not None else ['nothing']
        self._node.get_logger().info(
            f'restored from {path}: {counted(len(saved.episodes), "episode")}; selection: '
            f'{listed(names)}'
        )
        if saved.torn_bytes:
            self._node.get_logger().warning(
                f'{path} ends with {counted(saved.torn_bytes, "byte")} of an episode that was '
                'being saved when the last run was killed; that episode is lost'
            )
        return saved

    def append(
        self,
        episode: Episode,
        channel_names: tuple[str, ...],
        action_names: tuple[str, ...],
        renewals: float,
    ) -> bool:
        """Append an episode; return False if the whole file must be saved instead."""
        names = channel_names, action_names
        return self._saver is None or self._saver.append(episode, *names, renewals)

    def save(self, saved: Saved) -> None:
        """Replace the contents of the file. Never blocks."""
        if self._saver is not None:
            self._saver.save(saved)

    def stop(self) -> None:
        """Wait briefly for the last save."""
        if self._saver is not None:
            self._saver.stop()

    def report(self) -> DiagnosticStatus:
        """Log new errors and return the status."""
        saver = self._saver
        values = {'path': self._path}
        if saver is not None:
            if saver.num_saves or saver.error:
                self._error = saver.error
            values |= {
                'saves': saver.num_saves,
                'file bytes': saver.nbytes,
                'seconds of the last save': f'{saver.seconds:.3f}',
            }
        self._log_error()
        name = f'{diagnostics.name_of(self._node)}: storage'
        level = diagnostics.ERROR if self._error else diagnostics.OK
        return diagnostics.status(name, level, self._error or 'saving', values)

    def _log_error(self) -> None:
        if self._error not in ('', self._logged_error):
            self._node.get_logger().error(self._error)
        elif self._logged_error and not self._error:
            self._node.get_logger().info(f'{self._path} can be saved again')
        self._logged_error = self._error
