# SPDX-License-Identifier: Apache-2.0

"""The mathematics: which sensors the return depends on. Imports NumPy, SciPy and Numba only."""

from .conditional_mi import ConditionalMI
from .conditional_mi_selector import ConditionalMISelector
from .episode import Episode
from .kdr import KDR
from .kdr_selector import KDRSelector
from .lsmi import CRITERIA, Lsmi
from .permutation import PermutationTest, permutation_test
from .returns import discounted_returns
from .search import DIRECTIONS

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
    'permutation_test',
]
