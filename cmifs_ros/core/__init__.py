"""The mathematics: which sensors does the return depend on? NumPy and SciPy only."""

from .conditional_mi import ConditionalMI
from .episode import Episode
from .kdr import KDR
from .lsmi import CRITERIA, Lsmi
from .permutation import PermutationTest
from .returns import discounted_returns
from .search import DIRECTIONS
from .selector import ConditionalMISelector, KDRSelector

__all__ = [
    'CRITERIA',
    'DIRECTIONS',
    'KDR',
    'ConditionalMI',
    'ConditionalMISelector',
    'Episode',
    'KDRSelector',
    'Lsmi',
    'PermutationTest',
    'discounted_returns',
]
