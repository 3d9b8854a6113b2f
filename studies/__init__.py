# SPDX-License-Identifier: Apache-2.0

"""Studies of the package, run from a checkout: `python -m studies.paper.reproduce`."""

import sys

from cmifs_ros.tools.program import end_at_signals

if sys.argv[0] == '-m':  # Python is still looking for the study to run.
    end_at_signals()
