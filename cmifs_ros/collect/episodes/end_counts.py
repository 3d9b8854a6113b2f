# SPDX-License-Identifier: Apache-2.0

"""How episodes ended, and how many of each kind of end were lost.

Losses that depend on how an episode ends leave the survivors, of which one learns the wrong thing.
"""

from __future__ import annotations

from collections import Counter

from cmifs_ros.core.words import listed

#: Losses are said to depend on the end from so many on, if the shares differ by more than this.
_FEW, _DIFFERENCE = 3, 0.2


class EndCounts:
    """Count episodes by the kind of their end.

    Attributes
    ----------
    ended : collections.Counter
        All whose end was seen, by its kind.
    lost, shortened : dict of str to collections.Counter
        By kind, how many are lost, and why; and of how many the last steps are, and why.

    """

    def __init__(self):
        self.ended: Counter[str] = Counter()
        self.lost: dict[str, Counter[str]] = {}
        self.shortened: dict[str, Counter[str]] = {}

    def add(self, kind: str) -> None:
        """Count an episode that is whole."""
        self.ended[kind] += 1

    def add_lost(self, kind: str, why: str) -> None:
        """Count an episode that is lost."""
        self.ended[kind] += 1
        self.lost.setdefault(kind, Counter())[why] += 1

    def add_shortened(self, kind: str, why: str) -> None:
        """Count an episode that is kept without its last steps."""
        self.ended[kind] += 1
        self.shortened.setdefault(kind, Counter())[why] += 1

    def num_lost(self, kind: str) -> int:
        """Return how many episodes of a kind of end are lost."""
        return self.lost[kind].total() if kind in self.lost else 0

    def dropped_in_words(self) -> dict[str, int]:
        """Return a sentence for each kind of end of which something was dropped, and how often."""
        said = {self._lost_in_words(kind): self.num_lost(kind) for kind in self.lost}
        for kind, reasons in self.shortened.items():
            what = (
                f'last steps of episodes that ended by `{kind}`: {listed(list(reasons))}; their '
                f'rewards count at the last whole step (of {self.ended[kind]} that ended so)'
            )
            said[what] = reasons.total()
        return said

    def _lost_in_words(self, kind: str) -> str:
        ended, others = self.ended[kind], self.ended.total() - self.ended[kind]
        left = ended - self.num_lost(kind)
        kept = others - sum(map(self.num_lost, self.ended)) + self.num_lost(kind)
        rest = f', but {kept} of {others} that ended otherwise' if others else ''
        why = listed([why for why, _ in self.lost[kind].most_common(2)])
        how_many = f'{left} of {ended} are' if left else f'none of {ended} is'
        return f'episodes that ended by `{kind}`: {why}; {how_many} left{rest}'

    def problem(self) -> str:
        """Return where losses depend on how an episode ends, or nothing."""
        for kind in self.lost:
            ended, others = self.ended[kind], self.ended.total() - self.ended[kind]
            lost, all_lost = self.num_lost(kind), sum(map(self.num_lost, self.ended))
            share_of_others = (all_lost - lost) / others if others else 0.0
            if lost >= _FEW and lost / ended - share_of_others > _DIFFERENCE:
                return f'dropped {lost} {self._lost_in_words(kind)}'
        return ''
