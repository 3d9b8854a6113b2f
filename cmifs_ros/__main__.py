# SPDX-License-Identifier: Apache-2.0

"""`python3 -m cmifs_ros`: the command `cmifs`."""

import sys

from cmifs_ros.tools.program import cmifs

sys.exit(cmifs())
