# SPDX-License-Identifier: Apache-2.0

"""The finished trials of a study as a CSV file that survives interruption."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

from .trial import Outcome, Trial

COLUMNS = ('scenario', 'method', 'episodes', 'trial', 'seed', 'ranking', 'seconds')


class TrialLog:
    """Read the trials in a file, and append each finished trial.

    `ranking` holds numbers separated by blanks: indices from 0, or other results of a study. An
    incomplete last line, left by a killed process, is dropped.

    Parameters
    ----------
    path : pathlib.Path, optional
        Created if it does not exist; None: nothing is saved.
    number : callable
        Parses a number of a ranking.

    Attributes
    ----------
    outcomes : dict of Trial to Outcome

    Raises
    ------
    ValueError
        If the file has other contents.

    """

    def __init__(self, path: Path | None, number: Callable[[str], float] = int):
        self._path, self._number = path, number
        self.outcomes: dict[Trial, Outcome] = {}
        if path is None:
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        content = path.read_bytes() if path.exists() else b''
        complete = content[: content.rfind(b'\n') + 1]
        if complete != content:
            path.write_bytes(complete)
        if not complete:
            self._write(COLUMNS)
            return
        header, *rows = csv.reader(complete.decode(errors='replace').splitlines())
        if tuple(header) != COLUMNS:
            raise ValueError(f'{path} begins with {header}; expected the columns {COLUMNS}')
        for line, row in enumerate(rows, start=2):
            try:
                scenario, method, episodes, trial, seed, ranking, seconds = row
                key = Trial(scenario, method, int(episodes), int(trial), int(seed))
                found = tuple(map(self._number, ranking.split()))
                self.outcomes[key] = Outcome(key, found, float(seconds))
            except ValueError as error:
                raise ValueError(f'{path}, line {line} is not a trial: {row} ({error})') from error

    def add(self, outcome: Outcome) -> None:
        """Write one finished trial."""
        self.outcomes[outcome.trial] = outcome
        if self._path is None:
            return
        ranking = ' '.join(map(str, outcome.ranking))
        self._write((*outcome.trial, ranking, f'{outcome.seconds:.3f}'))

    def _write(self, row: tuple) -> None:
        with self._path.open('a', newline='') as file:
            csv.writer(file, lineterminator='\n').writerow(row)
