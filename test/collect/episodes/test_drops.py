# SPDX-License-Identifier: Apache-2.0

"""Every cause by which something is dropped is explained, in the code and in the docs."""

import ast
import re
from pathlib import Path

from cmifs_ros.collect.episodes.drops import CAUSES

ROOT = Path(__file__).resolve().parents[3]
DROPPING = {
    'drop_message', '_drop', 'break_off', '_discard_state', '_discard_reward',
    '_drop_first_states',
}  # fmt: skip


def causes_in(module):
    """Return the names given to what drops, kept as `cause`, or returned before a sentence."""
    for node in ast.walk(ast.parse(module.read_text())):
        parts = []
        if isinstance(node, ast.Call) and getattr(node.func, 'attr', '') in DROPPING:
            parts = node.args
        elif isinstance(node, ast.Assign) and getattr(node.targets[0], 'id', '') == 'cause':
            parts = [node.value]
        elif isinstance(node, ast.Return):
            parts = [e for n in ast.walk(node) if isinstance(n, ast.Tuple) for e in n.elts[:1]]
        constants = [n for part in parts for n in ast.walk(part) if isinstance(n, ast.Constant)]
        yield from (n.value for n in constants if re.fullmatch('[a-z]+(_[a-z]+)+', str(n.value)))


def test_every_cause_that_the_code_names_is_explained_and_no_other():
    modules = [p for p in (ROOT / 'cmifs_ros').rglob('*.py') if {'collect', 'ros'} & set(p.parts)]
    named = {cause for module in modules for cause in causes_in(module)}
    assert named == CAUSES.keys()


def test_the_table_of_the_docs_has_every_cause_with_the_same_words_and_a_remedy():
    page = (ROOT / 'docs' / 'interface.md').read_text()
    rows = re.findall(r'^\| `(\w+)` \| (.*?) \| (.+) \|$', page, re.MULTILINE)
    assert {cause: what for cause, what, _ in rows if cause in CAUSES} == CAUSES
