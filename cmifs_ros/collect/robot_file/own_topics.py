# SPDX-License-Identifier: Apache-2.0

"""Recognise topics that this package publishes: they are not sensors of the robot.

A reward among the channels would be the answer itself. Topics may be remapped, so they are
recognised by their contents.
"""

from __future__ import annotations

from collections.abc import Iterable

from cmifs_ros.collect.episodes.builder import RewardSample

#: Number of messages whose stamps are compared.
MAX_STAMPS = 1000
_STATE = 'sensor_msgs/msg/JointState'
_INDICES = 'std_msgs/msg/Int32MultiArray'
_REWARD_FIELDS = {*RewardSample._fields, 'action', 'gamma', 'half_life', 'target'}
#: The topics of a selector, and of the node that publishes the reward, without their namespaces.
_OF_SELECTOR = {
    'selected_state': _STATE,
    'selected_state/names': 'control_msgs/msg/Keys',
    'selected_state/values': 'control_msgs/msg/Float64Values',
    'scores': _STATE,
    'selected_indices': _INDICES,
    'selection': 'std_msgs/msg/String',
}
_BESIDE_REWARD = {'state', 'action'}
#: Share of equal stamps from which two topics belong together.
_SAME = 0.9
#: The `hardware_id` of this package's entries of /diagnostics.
HARDWARE_ID = 'cmifs_ros'


class Trace:
    """Evidence from a topic's messages that this package publishes it.

    Parameters
    ----------
    topic, kind : str
        Its name and the name of its type.

    """

    def __init__(self, topic: str, kind: str):
        self.topic, self.kind = topic, kind
        self.is_state = kind == _STATE  # Positions only, as this package publishes them.
        self.space, _, self.last = topic.rpartition('/')
        self.names: frozenset[str] = frozenset()
        self.stamps: set[int] = set()
        self.label = ''

    @property
    def is_open(self) -> bool:
        """Whether another message could add information."""
        return self.is_state and len(self.stamps) < MAX_STAMPS

    def look(self, message) -> None:
        """Observe a message."""
        if self.kind == _INDICES and message.layout.dim:
            self.label = message.layout.dim[0].label
        if not self.is_open:
            return
        if len(message.velocity) or len(message.effort):
            self.is_state = False
            return
        stamp = message.header.stamp
        self.stamps.add(stamp.sec * 10**9 + stamp.nanosec)
        self.names |= set(message.name)

    @property
    def is_of_selector(self) -> bool:
        """Whether its name and type are those of a selector's topic."""
        name = f'/{self.topic}'
        return any(
            kind == self.kind and name.endswith(f'/{end}') for end, kind in _OF_SELECTOR.items()
        )

    @property
    def is_reward(self) -> bool:
        """Whether it has the fields of a reward message."""
        if self.is_state and 'reward' in self.names:
            return self.last == 'reward' or self.names <= _REWARD_FIELDS
        return self.last == 'reward'

    def has_stamps_of(self, other: Trace) -> bool:
        """Return whether its messages have the stamps of another topic."""
        if not (self.is_state and self.stamps and other.stamps):
            return False
        begin = max(min(self.stamps), min(other.stamps))
        end = min(max(self.stamps), max(other.stamps))
        mine, its = ({s for s in t.stamps if begin <= s <= end} for t in (self, other))
        return len(mine & its) >= max(2, _SAME * max(len(mine), len(its)))


def own_topics(traces: Iterable[Trace]) -> dict[str, str]:
    """Return the topics that this package publishes or learns from, with the reason."""
    traces = list(traces)
    own: dict[str, str] = {}
    rewards = [trace for trace in traces if trace.is_reward]
    for trace in rewards:
        own[trace.topic] = 'a reward'
    states: list[Trace] = []
    for trace in traces:
        for reward in rewards:
            if trace.topic in own:
                break
            if trace.space == reward.space and trace.last in _BESIDE_REWARD:
                own[trace.topic] = f'it belongs to the reward {reward.topic}'
            elif trace.has_stamps_of(reward):
                own[trace.topic] = f'it has the stamps of the reward {reward.topic}'
            else:
                continue
            states.append(trace)
    channels = {name for state in states for name in state.names}
    stems = {name.rpartition(mark)[0] for name in channels for mark in '.['}
    for trace in traces:
        if trace.topic in own:
            continue
        if trace.is_of_selector or trace.label == 'channel':
            own[trace.topic] = 'published by a selector'
        elif trace.is_state and trace.names and trace.names <= channels | stems:
            own[trace.topic] = f'it has the channel names of {states[0].topic}'
    return own


def is_own_entry(entry) -> bool:
    """Return whether an entry of /diagnostics comes from a node of this package."""
    return getattr(entry, 'hardware_id', None) == HARDWARE_ID
