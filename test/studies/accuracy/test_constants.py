# SPDX-License-Identifier: Apache-2.0

"""The study of the test's constants finds each where it says, and leaves it as it was."""

import importlib

import pytest

from studies.accuracy.constants import CONSTANTS, changed


@pytest.mark.parametrize('constant', CONSTANTS, ids=lambda one: f'{one.module}.{one.name}')
def test_a_constant_is_changed_for_a_while(constant):
    module = importlib.import_module(f'cmifs_ros.core.{constant.module}')
    before, value = getattr(module, constant.name), constant.others[0]
    with changed(constant, value):
        assert getattr(module, constant.name) is value
    assert getattr(module, constant.name) is before
