# SPDX-License-Identifier: Apache-2.0

"""The causes by which messages and episodes are dropped; docs/interface.md has the remedies."""

from __future__ import annotations

#: What happened, by the name of the cause that diagnostics and logs count.
CAUSES = {
    'unusable_state': 'a state of another message type, or whose fields do not match its names',
    'malformed_reward': 'a reward message without a finite `reward`, or of another message type',
    'malformed_action': 'an action without names, with more or fewer values than names, or with a '
    'value that is not finite',
    'wrong_actions': 'an action with other names than the first',
    'wrong_length': 'a state with more or fewer values than names, or with none',
    'wrong_channels': 'a state with other channels than the first state that had a reward',
    'not_finite': 'a state with a value that is not a number',
    'equal_stamps': 'two different messages on one topic with the same stamp',
    'duplicate_stamp': 'the same message a second time',
    'lost_on_the_way': 'a message lost by the middleware',
    'too_late': 'a message older than a state and reward already paired',
    'state_without_reward': 'a state for which no reward has the same stamp',
    'reward_without_state': 'a reward for which no state has the same stamp',
    'lost_state': 'an episode in which a reward has no state',
    'step_gap': 'an episode in which a step is missing',
    'lost_end': 'an episode whose end was not seen',
    'joined_midway': 'an episode whose beginning was not seen',
    'time_backwards': 'an episode during which time was set back',
}


def explained(what: str, cause: str) -> str:
    """Return what was dropped and why, with the name of the cause in parentheses."""
    return f'{what}: {CAUSES[cause]} ({cause})'
