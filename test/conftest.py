# SPDX-License-Identifier: Apache-2.0

from collections import Counter
from pathlib import PurePath

import pytest
from hypothesis import settings

# The time of one example says more about the machine than about the code.
settings.register_profile('no_deadline', deadline=None)
settings.load_profile('no_deadline')


def pytest_terminal_summary(terminalreporter):
    """Say how long the tests of each folder took, the longest first."""
    seconds = Counter()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                folders = PurePath(report.nodeid.partition('::')[0]).parts[:-1]
                seconds['/'.join(folders[:2])] += report.duration
    if len(seconds) > 1:
        terminalreporter.section('seconds by folder')
        for folder, total in seconds.most_common():
            terminalreporter.write_line(f'{total:8.1f} {folder}')
