# SPDX-License-Identifier: Apache-2.0

"""Read the rules of a robot file: the reward, and the conditions that end an episode."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import yaml

from cmifs_ros.core.words import did_you_mean

from .expression import Expression
from .field_path import FieldPath
from .model import VALUE, Source
from .source_reader import SourceReader
from .yaml_nodes import shown


class RuleReader(SourceReader):
    """Read expressions and paths; compare their names with the sources."""

    def rule(
        self, node, what: str, numbers: frozenset[str], sources: Mapping[str, Source | None]
    ) -> Expression | FieldPath | None:
        """Return an expression or a path.

        `numbers` are the names of single numbers. `sources` are all sources by name; None stands
        for one that could not be read, which was reported already.
        """
        if node is None:
            return None
        if not isinstance(node, yaml.ScalarNode):
            self.note(node, f'{what} is {shown(node)}; expected an expression or a path')
            return None
        if node.value.startswith('/'):
            return self.path(node, what)
        try:
            rule = Expression(node.value)
        except ValueError as error:
            self.note(node, f'{what}: {error}')
            return None
        if unknown := sorted(rule.numbers - numbers):
            meant = '' if unknown[0] in sources else did_you_mean(unknown[0], sorted(numbers))
            way = _way_to_number(sources.get(unknown[0]))
            self.note(
                node,
                f'{what} uses {", ".join(unknown)[:60]}{meant}; expected names of channels, '
                f'actions or values that are single numbers{way}: '
                f'{", ".join(sorted(numbers))[:300]}',
            )
        for name, words in rule.words.items():
            if name not in sources or sources[name] is not None:
                problem = _problem_of_words(name, words, sources.get(name))
                if problem:
                    self.note(node, f'{what} {problem}')
        return rule

    def with_words(
        self, sources: tuple[Source, ...], rules: Iterable[Expression | FieldPath | None], node
    ) -> tuple[Source, ...]:
        """Return the sources; texts get the words they are compared with."""
        words: dict[str, set[str]] = {}
        numbers: set[str] = set()
        for rule in rules:
            if isinstance(rule, Expression):
                numbers |= rule.numbers
                for name, some in rule.words.items():
                    words.setdefault(name, set()).update(some)
        for name in sorted(numbers & words.keys() & {s.name for s in sources if s.role == VALUE}):
            self.note(
                node, f'{name} is compared with {min(words[name])!r} and used as a number; '
                'expected one of these',
            )  # fmt: skip
        with_words = [
            replace(source, words=tuple(sorted(words[source.name])))
            if source.name in words and source.role == VALUE
            else source
            for source in sources
        ]
        names = [name for source in with_words for name in source.names]
        if len(set(names)) < len(names) and not self.mistakes:
            repeated = next(name for name in names if names.count(name) > 1)
            self.note(
                node, f'{repeated!r} is a channel and also a word of the text '
                f'{repeated.split(".")[0]!r}; expected another name for one of them',
            )  # fmt: skip
        return tuple(with_words)


def _way_to_number(source: Source | None) -> str:
    """Return how an expression can use a single number of a source with several values."""
    if source is None:
        return ''
    if source.one_hot:
        return f' (of its categories: {source.name} == {source.one_hot[0]!r})'
    if source.path.is_list:
        entry = f'{source.path}[{source.path.indices[0]}]'
        return f' (for one entry of an array, add under values: {source.name}_0: "{entry}")'
    return ' (for one of several, add its path under values)'


def _problem_of_words(name: str, words: Iterable[str], source: Source | None) -> str:
    """Return why a source cannot be compared with words, or an empty text if it can."""
    if source is not None and source.one_hot:
        missing = sorted(set(words) - set(source.one_hot))
        if not missing:
            return ''
        return (
            f'compares {name} with {missing[0][:40]!r}; expected one of its one_hot: '
            f'{", ".join(source.one_hot)[:300]}'
        )
    if source is not None and source.role == VALUE and source.names == (name,):
        if source.over or source.inf:
            return f'compares {name} with a text; expected it without over and inf'
        return ''
    path = source.path if source is not None and source.encoder is None else '/task/status.data'
    return (
        f'compares {name[:60]} with {min(words)[:40]!r}; expected a text defined under values, '
        f'as in {name[:60]}: {path}, or a channel with one_hot'
    )
