"""A selection from what a file or a reply says of it, which may be anything."""

from __future__ import annotations

from cmifs_ros.core.channel_names import MAX_CHANNELS, MAX_NAME_LENGTH
from cmifs_ros.core.selection import Selection

#: What a selection may say of each sensor beside its score, or leave out.
EVIDENCE = (
    'statuses',
    'pvalues',
    'null_scores',
    'supporting_channels',
    'redundant_with',
    'stability',
)
#: What a selection may say of a sensor.
STATUSES = ('confirmed', 'tentative', 'rejected')


def selection_of(fields: dict | None) -> Selection | None:
    """Return a selection from its fields, or None from None.

    Raises
    ------
    ValueError, TypeError, KeyError
        If a field is missing or cannot be one.

    """
    if fields is None:
        return None
    selection = Selection(
        indices=tuple(count_of(index) for index in list_of(fields['indices'])),
        names=names_of(fields['names'], MAX_CHANNELS),
        ranking=names_of(fields['ranking'], MAX_CHANNELS),
        scores=tuple(float(score) for score in list_of(fields['scores'])),
        episodes=count_of(fields['episodes']),
        steps=count_of(fields['steps']),
        seconds=float(fields['seconds']),
        outdated=count_of(fields.get('outdated', 0)),
        means=tuple(float(mean) for mean in list_of(fields['means'])),
        spreads=tuple(float(spread) for spread in list_of(fields['spreads'])),
        statuses=tuple(_status(status) for status in list_of(fields.get('statuses', []))),
        pvalues=tuple(float(pvalue) for pvalue in list_of(fields.get('pvalues', []))),
        null_scores=tuple(_triple(scores) for scores in list_of(fields.get('null_scores', []))),
        supporting_channels=tuple(
            names_of(n, MAX_CHANNELS) for n in list_of(fields.get('supporting_channels', []))
        ),
        redundant_with=tuple(
            names_of(n, MAX_CHANNELS) for n in list_of(fields.get('redundant_with', []))
        ),
        stability=tuple(float(share) for share in list_of(fields.get('stability', []))),
    )
    for what in EVIDENCE:
        count = len(getattr(selection, what))
        if count not in (0, len(selection.ranking)):
            raise ValueError(f'{count} {what} for {len(selection.ranking)} sensors')
    if len(selection.means) != len(selection.spreads):
        raise ValueError(f'{len(selection.means)} means for {len(selection.spreads)} spreads')
    if not len(selection.names) == len(selection.indices) <= MAX_CHANNELS:
        raise ValueError(f'{len(selection.indices)} indices for {len(selection.names)} names')
    if len(selection.scores) != len(selection.ranking):
        raise ValueError(f'{len(selection.scores)} scores for {len(selection.ranking)} sensors')
    if max(selection.indices, default=0) >= MAX_CHANNELS:
        raise ValueError(f'index {max(selection.indices)}; expected less than {MAX_CHANNELS}')
    return selection


def _status(value) -> str:
    if value not in STATUSES:
        raise ValueError(f'status {value!r}; expected one of {", ".join(STATUSES)}')
    return value


def _triple(value) -> tuple[float, float, float]:
    low, middle, high = map(float, list_of(value))
    return low, middle, high


def list_of(value) -> list:
    """Return a value that has to be a list; else raise TypeError."""
    if not isinstance(value, list):
        raise TypeError(f'{type(value).__name__} in place of a list')
    return value


def count_of(value, least: int = 0) -> int:
    """Return a value that has to be an integer of at least `least`; else raise ValueError."""
    if type(value) is not int or value < least:
        raise ValueError(f'{value!r} in place of an integer of at least {least}')
    return value


def names_of(value, most: int) -> tuple[str, ...]:
    """Return a value that has to be a list of different names; else raise ValueError."""
    names = tuple(list_of(value))
    if len(names) > most or len(set(names)) < len(names):
        raise ValueError(f'{len(names)} names; expected at most {most}, all different')
    if not all(isinstance(name, str) and 0 < len(name) <= MAX_NAME_LENGTH for name in names):
        raise ValueError(f'a name that is no text of 1 to {MAX_NAME_LENGTH} characters')
    return names
