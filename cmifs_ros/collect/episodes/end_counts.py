# SPDX-License-Identifier: Apache-2.0

"""Count how episodes ended, and how many of each kind of end were lost.

If losses depend on how an episode ends, the remaining episodes are biased.
"""

from __future__ import annotations

from collections import Counter

#: Losses depend on the end if at least this many are lost and the shares differ by more than this.
_FEW, _DIFFERENCE = 3, 0.2


class EndCounts:
    """Count episodes by the kind of their end.

    Attributes
    ----------
    ended : collections.Counter
        Number of episodes with a known end, by kind.
    lost, shortened : dict of str to collections.Counter
        By kind of end, numbers by cause: of lost episodes, and of those without their last steps.

    """

    def __init__(self):
        self.ended: Counter[str] = Counter()
        self.lost: dict[str, Counter[str]] = {}
        self.shortened: dict[str, Counter[str]] = {}

    def __add__(self, other: EndCounts) -> EndCounts:
        """Return the counts of two recordings together."""
        total = EndCounts()
        for one in (self, other):
            total.ended.update(one.ended)
            for counts, of_one in ((total.lost, one.lost), (total.shortened, one.shortened)):
                for kind, reasons in of_one.items():
                    counts.setdefault(kind, Counter()).update(reasons)
        return total

    def add(self, kind: str) -> None:
        """Count a complete episode."""
        self.ended[kind] += 1

    def add_lost(self, kind: str, why: str) -> None:
        """Count a lost episode."""
        self.ended[kind] += 1
        self.lost.setdefault(kind, Counter())[why] += 1

    def add_shortened(self, kind: str, why: str) -> None:
        """Count an episode kept without its last steps."""
        self.ended[kind] += 1
        self.shortened.setdefault(kind, Counter())[why] += 1

    def num_lost(self, kind: str) -> int:
        """Return the number of lost episodes with a kind of end."""
        return self.lost[kind].total() if kind in self.lost else 0

    @property
    def total_lost(self) -> int:
        """Number of lost episodes with any kind of end."""
        return sum(map(self.num_lost, self.lost))

    def dropped_in_words(self) -> dict[str, int]:
        """Return messages about losses by kind of end, with their counts."""
        said = {self._lost_in_words(kind): self.num_lost(kind) for kind in self.lost}
        for kind, reasons in self.shortened.items():
            what = (
                f'last steps of episodes that ended by `{kind}`: {_most(reasons)}; their '
                f'rewards count at the last complete step (of {self.ended[kind]} that ended '
                'this way)'
            )
            said[what] = reasons.total()
        return said

    def _lost_in_words(self, kind: str) -> str:
        ended, others = self.ended[kind], self.ended.total() - self.ended[kind]
        left = ended - self.num_lost(kind)
        kept = others - sum(map(self.num_lost, self.ended)) + self.num_lost(kind)
        rest = f', {"but" if kept else "and"} {_of(kept, others)} that ended otherwise'
        how_many = f'{_of(left, ended)} {"are" if left else "is"} left{rest if others else ""}'
        return f'episodes that ended by `{kind}`: {_most(self.lost[kind])}; {how_many}'

    def problem(self) -> str:
        """Return a message if losses depend on how an episode ends; otherwise empty."""
        for kind in self.lost:
            ended, others = self.ended[kind], self.ended.total() - self.ended[kind]
            lost, all_lost = self.num_lost(kind), sum(map(self.num_lost, self.ended))
            share_of_others = (all_lost - lost) / others if others else 0.0
            if lost >= _FEW and lost / ended - share_of_others > _DIFFERENCE:
                return f'dropped {lost} {self._lost_in_words(kind)}'
        return ''


def _of(count: int, total: int) -> str:
    return f'{count or "none"} of {total}'


def _most(reasons: Counter[str]) -> str:
    """Return the two most frequent reasons."""
    return ', '.join(reason for reason, _ in reasons.most_common(2))
