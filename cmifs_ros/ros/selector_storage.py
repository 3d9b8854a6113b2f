# SPDX-License-Identifier: Apache-2.0

"""What the selector keeps over a restart: its episodes and its selection, in a file."""

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
    """Take up the file of the last run and keep it up to date.

    A file that cannot be used is kept aside.

    Parameters
    ----------
    node : rclpy.node.Node
    path : str

    Raises
    ------
    ValueError
        If the path cannot be a file of its own.

    """

    def __init__(self, node: Node, path: str):
        self._node, self._path = node, os.path.abspath(os.path.expanduser(path))
        self._saver: EpisodeSaver | None = EpisodeSaver(self._path)
        self._error = self._logged_error = ''

    def restore(self, max_episodes: int, max_bytes: int) -> Saved | None:
        """Return what the last run left, or None if that is nothing of use."""
        path = self._path
        try:
            saved = read_episodes(path, max_episodes, max_bytes)
        except FileNotFoundError:
            self.save(Saved(None, ()))  # A disk that lets nothing be saved is told of now.
            return None
        except (OSError, RefusedFileError) as error:
            reason = f'{path} {error.strerror}' if isinstance(error, OSError) else error
            try:
                aside = f'is kept as {episode_file.set_aside(path)}'
            except OSError as failure:  # Nor may it be overwritten.
                self.stop()
                self._saver = None
                aside = f'stays ({failure.strerror}), and nothing is saved'
            self._error = f'{reason}; it {aside}, and the selector starts empty'
            self._log_error()
            return None
        names = saved.selection.names if saved.selection is not None else ['nothing']
        self._node.get_logger().info(
            f'{path} brings back {counted(len(saved.episodes), "episode")}, and the selection of '
            f'{listed(names)}'
        )
        if saved.torn_bytes:
            self._node.get_logger().warning(
                f'{path} ends with {counted(saved.torn_bytes, "byte")} of an episode that was '
                'being saved when the last run was killed; that episode is lost'
            )
        return saved

    def append(
        self, episode: Episode, channel_names: tuple[str, ...], action_names: tuple[str, ...]
    ) -> bool:
        """Keep one more episode; return False if everything is to be saved instead."""
        return self._saver is None or self._saver.append(episode, channel_names, action_names)

    def save(self, saved: Saved) -> None:
        """Keep this in place of all before. Never blocks."""
        if self._saver is not None:
            self._saver.save(saved)

    def stop(self) -> None:
        """Wait a little for the last save."""
        if self._saver is not None:
            self._saver.stop()

    def report(self, name: str) -> DiagnosticStatus:
        """Log what is new, and return the status of this name; without a saver nothing is saved."""
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
        level = diagnostics.ERROR if self._error else diagnostics.OK
        return diagnostics.status(name, level, self._error or 'saving', values)

    def _log_error(self) -> None:
        if self._error not in ('', self._logged_error):
            self._node.get_logger().error(self._error)
        elif self._logged_error and not self._error:
            self._node.get_logger().info(f'{self._path} is saved again')
        self._logged_error = self._error
