# SPDX-License-Identifier: Apache-2.0

"""Sphinx settings: these pages and the API reference. `make docs` builds them."""

import re
import sys
from pathlib import Path

_DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(_DOCS.parent))  # rosdoc2 runs a copy, with the package installed.

project = 'cmifs_ros'
author = 'cmifs_ros maintainers'
copyright = f'2026, {author}. Licence: Apache-2.0'
root_doc = 'index'
extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.napoleon',
    'sphinx.ext.viewcode',
]
html_theme = 'alabaster'
html_theme_options = {'page_width': '1100px', 'sidebar_width': '240px'}
myst_heading_anchors = 4
napoleon_google_docstring = False
napoleon_use_ivar = True
autodoc_member_order = 'bysource'
autodoc_typehints = 'none'  # The docstrings give types and shapes.
# A forge draws the one diagram; here it is shown as text.
suppress_warnings = ['misc.highlighting_failure']

#: Links to files outside of docs/ lead to the repository. See also `url` in package.xml.
_REPOSITORY = 'https://example.com/cmifs_ros/blob/main/'


def _translate(app, name: str, source: list[str]) -> None:
    """Translate what a forge understands and MyST does not."""
    text = re.sub(r'\]\(\.\./([^)]*)\)', rf']({_REPOSITORY}\1)', source[0])
    source[0] = re.sub(r'<a id="([\w-]+)"></a>', r'(\1)=', text)


def setup(app) -> None:
    """Register the translation."""
    app.connect('source-read', _translate)
