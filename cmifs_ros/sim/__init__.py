"""The grid world of the paper and its policy. Knows no ROS."""

from .grid_world import SCENARIOS, GridWorld, channel_names
from .policy import preferred_action, sample_action
from .rollout import rollout

__all__ = [
    'SCENARIOS',
    'GridWorld',
    'channel_names',
    'preferred_action',
    'rollout',
    'sample_action',
]
