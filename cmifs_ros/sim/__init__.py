# SPDX-License-Identifier: Apache-2.0

"""Simulated worlds, without ROS: the paper's grid world and chain, and Gymnasium environments."""

from .chain import rollout_chain
from .grid_world import SCENARIOS, GridWorld, channel_names
from .policy import preferred_action, sample_action
from .rollout import rollout

__all__ = [
    'SCENARIOS',
    'GridWorld',
    'channel_names',
    'preferred_action',
    'rollout',
    'rollout_chain',
    'sample_action',
]
