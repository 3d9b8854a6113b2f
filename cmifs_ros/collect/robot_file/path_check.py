# SPDX-License-Identifier: Apache-2.0

"""Check the paths of a robot file against the message types of its topics."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from cmifs_ros.core.words import did_you_mean, listed

from .field_path import FieldPath
from .model import RobotFile, Source
from .observed_fields import TypeField

#: Returns the fields of a message type, in order.
FieldsOf = Callable[[str], Sequence[TypeField]]


class _WrongPathError(Exception):
    """A message type lacks what a path names; the message says what."""


def problems_of_paths(robot: RobotFile, types: Mapping[str, str], fields_of: FieldsOf) -> list[str]:
    """Return problems of the paths in a robot file, each as a sentence with a remedy.

    Names in arrays, such as joints, and the lengths of arrays are not part of a type.

    Parameters
    ----------
    robot : RobotFile
    types : mapping of str to str
        The known message types of its topics.
    fields_of : callable
        Returns the fields of a message type as `TypeField`s.

    """
    return list(_problems(robot, types, fields_of))


def _problems(robot: RobotFile, types: Mapping[str, str], fields_of: FieldsOf) -> Iterator[str]:
    for source in robot.sources:
        kind = types.get(source.path.topic)
        if kind is not None:
            try:
                _check_source(source, kind, fields_of)
            except _WrongPathError as error:
                yield f'{source.name}: {error}'
    rules = {
        'reward': robot.reward,
        'episode.terminated': robot.terminated,
        'episode.truncated': robot.truncated,
    }
    for name, rule in rules.items():
        if isinstance(rule, FieldPath) and rule.fields and rule.topic in types:
            try:
                _check_number(rule, _what(rule, types[rule.topic], fields_of), fields_of)
                if _what(rule, types[rule.topic], fields_of) == 'text':
                    raise _WrongPathError(
                        f'{rule} is a text; define it under values, as in status: {rule}, and '
                        "compare it: status == 'done'"
                    )
            except _WrongPathError as error:
                yield f'{name}: {error}'


def _check_source(source: Source, kind: str, fields_of: FieldsOf) -> None:
    what = _what(source.path, kind, fields_of)
    if source.encoder is not None:
        names = [field.name for field in fields_of(what)] if '/' in what else []
        if what.endswith('[]') or not source.encoder.fits(names.__contains__):
            raise _WrongPathError(
                f'{source.path} is {_described(what, fields_of)}; expected '
                f'{source.encoder.expected} for as: {source.encoder.name}'
            )
        return
    if source.words and what in ('number', 'numbers'):
        raise _WrongPathError(
            f'{source.path} is {_described(what, fields_of)}; expected a text, because it is '
            f'compared with {source.words[0]!r}'
        )
    _check_number(source.path, what, fields_of)
    if source.inf is not None:
        _what(FieldPath(source.path.topic, (source.inf,)), kind, fields_of)


def _check_number(path: FieldPath, what: str, fields_of: FieldsOf) -> None:
    """Raise unless a field is a number, a text or, with an index or name, an array of these."""
    is_array = what == 'numbers' or what.endswith('[]') or not what
    if (path.indices or path.names) and not is_array:
        end = f'{{{",".join(path.names)}}}' if path.names else f'[{path.indices[0]}]'
        expected = f'an array for {end}'
    elif what == 'numbers' and not (path.indices or path.names):
        expected = 'an entry of it, such as [0], [0:360:30] or {name}'
    elif '/' in what:
        expected = 'a number: name a field of it'
    else:
        return
    raise _WrongPathError(f'{path} is {_described(what, fields_of)}; expected {expected}')


def _what(path: FieldPath, kind: str, fields_of: FieldsOf) -> str:
    """Return what the field at the end of a path is; see `TypeField`."""
    what, above = kind, FieldPath(path.topic)
    for depth, field in enumerate(path.fields):
        here = FieldPath(path.topic, path.fields[:depth])
        if field[0] in '{[':
            if not what.endswith('[]'):
                raise _WrongPathError(
                    f'{here} is {_described(what, fields_of)}; expected an array for {field}'
                )
            what = what.removesuffix('[]')
            continue
        above = here
        if what.endswith('[]') or '/' not in what:
            remedy = (
                f'; expected an entry of it, such as {{name}} or [0], before .{field}'
                if what.endswith('[]')
                else f', which has no field {field!r}; remove .{field}'
            )
            raise _WrongPathError(f'{above} is {_described(what, fields_of)}{remedy}')
        fields = {field.name: field.what for field in fields_of(what)}
        if field not in fields:
            raise _WrongPathError(
                f'{above} has no field {field!r}{did_you_mean(field, list(fields))}; expected one '
                f'of {listed(list(fields))}'
            )
        what = fields[field]
    return what


def _described(what: str, fields_of: FieldsOf) -> str:
    if what.endswith('[]'):
        return f'an array of {what.removesuffix("[]")}'
    if '/' in what:
        return f'a {what.rpartition("/")[2]} of {listed([field.name for field in fields_of(what)])}'
    return {'number': 'a number', 'numbers': 'an array', 'text': 'a text'}.get(what, 'an array')
