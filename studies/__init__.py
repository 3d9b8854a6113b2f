# SPDX-License-Identifier: Apache-2.0

"""What proves the package, run from a checkout: `python -m studies.paper.reproduce`."""

import sys

from cmifs_ros.tools.program import end_at_signals

if sys.argv[0] == '-m':  # Python still looks for the study that it is to run.
    end_at_signals()
