# SPDX-License-Identifier: Apache-2.0

"""The finished trials of a study as a CSV file that survives interruption."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cmifs_ros.tools.program import CommandError

from .rows import RowLog
from .trial import Outcome, Trial

COLUMNS = ('scenario', 'method', 'episodes', 'trial', 'seed', 'ranking', 'seconds')


class TrialLog:
    """Read the trials in a file, and append each finished trial.

    `ranking` holds numbers separated by blanks: indices from 0, or other results of a study.

    Parameters
    ----------
    path : pathlib.Path, optional
        As of `RowLog`.
    number : callable
        Parses a number of a ranking.

    Attributes
    ----------
    outcomes : dict of Trial to Outcome

    Raises
    ------
    CommandError
        If the file cannot be used or has other contents.

    """

    def __init__(self, path: Path | None, number: Callable[[str], float] = int):
        self._rows = RowLog(path, COLUMNS)
        self.outcomes: dict[Trial, Outcome] = {}
        for line, row in enumerate(self._rows.rows, start=2):
            try:
                numbers = (int(row[column]) for column in ('episodes', 'trial', 'seed'))
                trial = Trial(row['scenario'], row['method'], *numbers)
                ranking = tuple(map(number, row['ranking'].split()))
                self.outcomes[trial] = Outcome(trial, ranking, float(row['seconds']))
            except ValueError as error:
                raise CommandError(
                    f'{path}, line {line} is not a trial: {list(row.values())} ({error})'
                ) from error

    def add(self, outcome: Outcome) -> None:
        """Write one finished trial."""
        self.outcomes[outcome.trial] = outcome
        ranking = ' '.join(map(str, outcome.ranking))
        self._rows.add([(*outcome.trial, ranking, f'{outcome.seconds:.3f}')])


def kept(path: Path | None) -> str:
    """Return what is left of an interrupted study with this log."""
    return 'nothing is kept' if path is None else 'the same command continues where it stopped'
