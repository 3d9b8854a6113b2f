# SPDX-License-Identifier: Apache-2.0

"""Sensor-subset selection for robots that learn, by conditional mutual information."""
