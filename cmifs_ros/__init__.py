"""Sensor-subset selection for robots that learn, by conditional mutual information."""
