# SPDX-License-Identifier: Apache-2.0

"""Expressions of a robot file: what they compute and what they refuse."""

from math import isnan, nan

import pytest

from cmifs_ros.collect.robot_file.expression import Expression


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('before(d) - d + 10 * won', 1.5 + 10),
        ('d ** 2', 6.25),
        ('1 < d < 3 and not won == 0', 1),
        ('min(d, 1) + abs(-2) + hypot(3, 4)', 8),
    ],
)
def test_it_computes(text, expected):
    assert Expression(text)({'d': 2.5, 'won': 1.0}, {'d': 4.0}) == expected


def test_what_has_no_value_is_nan():
    assert isnan(Expression('1 / d')({'d': 0.0}, {}))
    assert isnan(Expression('d ** 8')({'d': 1e300}, {}))


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('d < 1', None), ('d != 1', None), ('not d', None), ('not d < 1', None),
        ('0 < d < 1', None),
        ('d or 0', None), ('d and 1', None), ('d or 1', 1), ('1 or d', 1), ('d and 0', 0),
        ('0 and d', 0), ('d ** 0', None), ('min(1, d)', None), ('max(d, 1)', None),
        ('hypot(before(d), exp(800))', None), ('e < 1 or d < 1', 1), ('e > 1 or d < 1', None),
    ],
)  # fmt: skip
def test_what_is_not_known_stays_so_unless_the_rest_decides(text, expected):
    value = Expression(text)({'d': nan, 'e': 0.0}, {'d': nan})
    assert isnan(value) if expected is None else value == expected


@pytest.mark.parametrize(
    ('text', 'now', 'before', 'expected'),
    [
        ("status == 'done'", 'done', 'idle', 1),
        ("status == 'done'", 'failed', 'done', 0),
        ("status != 'done'", 'failed', 'done', 1),
        ("'done' == before(status)", 'failed', 'done', 1),
        ("10 * (status == 'done') - 3 * (before(status) != 'done')", 'done', 'idle', 7),
        ("status == 'done' and before(status) != 'done'", 'done', 'idle', 1),
        ("status == 'done'", None, 'done', None),
        ("status != 'done'", None, 'done', None),
    ],
)  # fmt: skip
def test_a_text_is_compared_with_a_word(text, now, before, expected):
    expression = Expression(text)
    assert (set(expression.names), set(expression.numbers)) == ({'status'}, set())
    words = expression.words['status']
    now, before = (
        {f'status.{word}': nan if said is None else float(said == word) for word in words}
        for said in (now, before)
    )
    value = expression(now, before)
    assert isnan(value) if expected is None else value == expected


@pytest.mark.parametrize(
    'text', ["'done'", "status < 'done'", "status == 'a' == 1", "'a' == 'b'", "abs('a')", "d + 'a'"]
)
def test_a_text_is_not_calculated_with(text):
    with pytest.raises(ValueError, match=r'the text .*; expected a comparison by == or !='):
        Expression(text)


@pytest.mark.parametrize(
    'text',
    ['9**9**9', '2 ** d', '().__class__', '__import__("os")', '"a" * 9', 'd[0]', 'open(d)',
     'lambda: 1', '[d for d in d]', '(' * 500, '-' * 900 + '1', '+'.join('d' * 400), '',
     '1 if d else 2',     'd.real', 'before(1)', 'abs(*d)', '1' * 900],
)  # fmt: skip
def test_what_is_hostile_is_refused_in_words(text):
    with pytest.raises(ValueError, match=r'expected|at most|split|beyond'):
        Expression(text)
