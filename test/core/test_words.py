# SPDX-License-Identifier: Apache-2.0

from cmifs_ros.core.words import counted


def test_one_is_no_plural():
    assert [counted(n, 'whole episode') for n in (0, 1, 2, '1', '?')] == [
        '0 whole episodes', '1 whole episode', '2 whole episodes', '1 whole episode',
        '? whole episodes',
    ]  # fmt: skip
