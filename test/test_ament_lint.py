# SPDX-License-Identifier: Apache-2.0

"""The linters of ROS 2, where these are installed. `make lint` runs ruff, which checks more."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = [str(ROOT / folder) for folder in ('cmifs_ros', 'studies', 'test')]
#: Public names have docstrings by review, not by rule; those of properties are no commands.
NOT_ASKED = ['D100', 'D101', 'D102', 'D103', 'D104', 'D105', 'D401']


def test_flake8():
    pytest.importorskip('flake8')
    lint = pytest.importorskip('ament_flake8.main')
    config = str(ROOT / 'test' / 'ament_flake8.ini')
    failed, errors = lint.main_with_errors(argv=['--config', config, *FOLDERS])
    assert not failed, '\n'.join(errors)


def test_pep257():
    pytest.importorskip('pydocstyle')
    lint = pytest.importorskip('ament_pep257.main')
    ignored = ['--add-ignore', *NOT_ASKED]
    assert lint.main(argv=[*FOLDERS[:2], '--convention', 'numpy', *ignored]) == 0
