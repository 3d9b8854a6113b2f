# SPDX-License-Identifier: Apache-2.0

"""The robot file: which topics give channels, the reward and the ends of episodes."""

from .model import RobotFile
from .reader import RobotFileError, load_robot_file, parse_robot_file

__all__ = ['RobotFile', 'RobotFileError', 'load_robot_file', 'parse_robot_file']
