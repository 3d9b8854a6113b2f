"""The mathematics: which sensors does the return depend on? NumPy and SciPy only."""

from .buffer import EpisodeBuffer
from .conditional_mi import ConditionalMI
from .episode import Episode
from .lsmi import CRITERIA, Lsmi
from .returns import discounted_returns
from .search import DIRECTIONS
from .selector import ConditionalMISelector

__all__ = [
    'CRITERIA',
    'DIRECTIONS',
    'ConditionalMI',
    'ConditionalMISelector',
    'Episode',
    'EpisodeBuffer',
    'Lsmi',
    'discounted_returns',
]
