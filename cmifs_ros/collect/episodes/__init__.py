# SPDX-License-Identifier: Apache-2.0

"""From states and rewards to episodes: pairing, buffer, file, filter."""

from .file_format import Saved
from .file_reader import RefusedFileError, read_episodes

__all__ = ['RefusedFileError', 'Saved', 'read_episodes']
