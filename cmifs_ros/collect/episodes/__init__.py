"""From states and rewards to episodes: pairing, buffer, file, filter."""

from .file import Saved, load_episodes

__all__ = ['Saved', 'load_episodes']
