# SPDX-License-Identifier: Apache-2.0

"""The file that keeps the selector's episodes and its selection over a restart."""

from __future__ import annotations

import os
import time

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from cmifs_ros.collect.episodes import file as episode_file
from cmifs_ros.collect.episodes.buffer import EpisodeBuffer
from cmifs_ros.collect.episodes.file_format import Saved
from cmifs_ros.collect.episodes.file_reader import RefusedFileError, read_episodes
from cmifs_ros.collect.episodes.saver import EpisodeSaver
from cmifs_ros.core import Episode
from cmifs_ros.core.words import counted, listed

from . import diagnostics
from .selector_input import SelectorInput
from .selector_output import SelectorOutput


class SelectorStorage:
    """Restore the last run from its file, and keep the file up to date.

    An unusable file is renamed, not deleted. Nothing here waits for the disk.

    Parameters
    ----------
    node : rclpy.node.Node
    path : str
    buffer : EpisodeBuffer
        Holds the episodes.
    source : SelectorInput
        Knows the names of their channels and actions.
    output : SelectorOutput
        Holds the selection.

    Raises
    ------
    ValueError
        If the path cannot be used for a file.

    """

    def __init__(
        self,
        node: Node,
        path: str,
        buffer: EpisodeBuffer,
        source: SelectorInput,
        output: SelectorOutput,
    ):
        self._node, self._path = node, os.path.abspath(os.path.expanduser(path))
        self._buffer, self._input, self._output = buffer, source, output
        self._saver: EpisodeSaver | None = EpisodeSaver(self._path)
        self._error = self._logged_error = ''

    def restore(self) -> bool:
        """Continue the last run; return whether there is anything to continue."""
        saved = self._read()
        if saved is None:
            return False
        for episode in saved.episodes:
            self._buffer.append(episode)
        self._buffer.renewals = max(self._buffer.renewals, saved.renewals)
        if saved.episodes:  # After they were cleared the first state determines the channels.
            self._input.restore_names(saved.channel_names, saved.action_names)
        if saved.selection is not None:
            age = max(0.0, time.time() - saved.selected_at)
            self._output.restore(saved.selection, saved.channel_names, age)
        self.save()
        return True

    def append(self, episode: Episode) -> None:
        """Append an episode that the buffer has just taken."""
        names = self._input.channel_names, self._input.action_names
        if self._saver is not None and not self._saver.append(
            episode, *names, self._buffer.renewals
        ):
            self.save()

    def save(self) -> None:
        """Replace the contents of the file."""
        if self._saver is None:
            return
        in_use, channels = self._output.in_use, self._input.channel_names
        selection, selected_at = None, 0.0
        if in_use is not None:
            selection, selected_at = in_use.selection, time.time() - in_use.age
            # None if the episodes were cleared.
            channels = in_use.channel_names if channels is None else channels
        self._saver.save(
            Saved(
                channels,
                self._buffer.snapshot(),
                selection,
                selected_at,
                action_names=self._input.action_names,
                renewals=self._buffer.renewals,
            )
        )

    def _read(self) -> Saved | None:
        """Return what the last run saved, or None if nothing usable."""
        path = self._path
        try:
            saved = read_episodes(path, self._buffer.max_episodes, self._buffer.max_bytes)
        except FileNotFoundError:
            self.save()  # A disk that is not writable is reported now.
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
