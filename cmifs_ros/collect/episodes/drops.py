"""Why messages and episodes are dropped; docs/interface.md has the remedies."""

from __future__ import annotations

#: By the cause's name, which diagnostics and logs count it by, what happened.
CAUSES = {
    'unusable_state': 'a state of another type, or whose fields do not go with its names',
    'malformed_reward': 'a reward message without a finite `reward`, or of another type',
    'wrong_length': 'a state with more or fewer values than names, or with none',
    'wrong_channels': 'a state with other channels than the first that had a reward',
    'not_finite': 'a state with a value that is not a number',
    'equal_stamps': 'two different messages of one topic with the same stamp',
    'duplicate_stamp': 'the same message a second time',
    'lost_on_the_way': 'a message that the middleware lost',
    'too_late': 'a message older than a pair that was complete already',
    'state_without_reward': 'no reward has the stamp of the state',
    'reward_without_state': 'no state has the stamp of the reward',
    'lost_state': 'a reward of the episode has no state',
    'step_gap': 'a step of the episode is missing',
    'lost_end': 'the end of the episode was not seen',
    'joined_midway': 'the beginning of the episode was not seen',
    'time_backwards': 'time was set back during the episode',
}


def explained(what: str, cause: str) -> str:
    """Return what was dropped, and why, in words with the name of the cause."""
    return f'{what}: {CAUSES[cause]} ({cause})'
