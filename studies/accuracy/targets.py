# SPDX-License-Identifier: Apache-2.0

"""How often each target gets exactly the sensors it needs, compared with peers.

`return` and `decision` are tested on recordings with random actions, `action` on those of a skilled
controller; for these, the target `return` must warn that it shows little. With the states of other
episodes, no sensor is needed.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from importlib.util import find_spec

import numpy as np

from cmifs_ros.core import ConditionalMISelector, Episode
from cmifs_ros.core.returns import discounted_returns
from cmifs_ros.core.shadows import exchange
from cmifs_ros.core.targets import ACTION, DECISION, RETURN, TARGETS
from cmifs_ros.tools.program import exit_code
from studies.methods.conditional_importance import conditional_selection
from studies.methods.forests import forest_importance
from studies.methods.knockoffs import sequential_knockoffs
from studies.methods.recursive_forests import recursive_selection
from studies.tasks.control import CONTROL_WORLDS, rollout_control
from studies.trials.arguments import add_log, add_names, study_parser
from studies.trials.log import TrialLog, kept
from studies.trials.parallel import finish
from studies.trials.statistics import mean_and_error
from studies.trials.tables import markdown_table
from studies.trials.trial import Outcome, Results, Trial

_GAMMA = 0.95
#: What else is asked of a world, beside the targets themselves: each by a name in the log.
SHUFFLED = {f'{target}_shuffled': target for target in TARGETS}
WARNING = 'warning'
RECURSIVE, KNOCKOFFS = 'recursive', 'knockoffs'
FOREST, FOREST_OF_ACTION = 'forest', 'forest_of_action'
CONDITIONAL, CONDITIONAL_OF_ACTION = 'conditional', 'conditional_of_action'
#: By the package that they need.
PEERS = {
    'sklearn': (RECURSIVE, FOREST, FOREST_OF_ACTION),
    'hidimstat': (KNOCKOFFS, CONDITIONAL, CONDITIONAL_OF_ACTION),
}
#: What is asked of a skilled controller.
SKILLED = (ACTION, WARNING, FOREST_OF_ACTION, CONDITIONAL_OF_ACTION)
#: The share of exact trials that is asked for.
ASKED = {
    **dict.fromkeys(((w, RETURN) for w in ('match', 'secret_key', 'toy', 'autoregressive')), 90),
    **dict.fromkeys(((w, DECISION) for w in ('stakes', 'mixed', 'match')), 90),
    **dict.fromkeys(((w, ACTION) for w in CONTROL_WORLDS), 90),
    **{('nothing', target): 95 for target in TARGETS},
}


def questions(world: str) -> list[str]:
    """Return what is asked of a world."""
    is_without_effect = not any(CONTROL_WORLDS[world].needed_for.values())
    wanted = [*dict.fromkeys((RETURN, *CONTROL_WORLDS[world].needed_for)), *SHUFFLED]
    if is_without_effect:
        return wanted
    peers = [peer for package, peers in PEERS.items() if find_spec(package) for peer in peers]
    return [*wanted, WARNING, *peers]


def run_target(trial: Trial) -> Outcome:
    """Return the channels found; of a warning, a single number if there is one."""
    is_skilled = SHUFFLED.get(trial.method, trial.method) in SKILLED
    episodes = rollout_control(trial.scenario, trial.episodes, trial.seed, is_skilled=is_skilled)
    start = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', UserWarning)  # Ours are in `warnings_`.
        if trial.method == RECURSIVE:
            found = recursive_selection(episodes, trial.seed)
        elif trial.method == KNOCKOFFS:
            found = sequential_knockoffs(episodes, trial.seed)
        elif trial.method == FOREST:
            found = _by_importance(episodes, trial.seed)
        elif trial.method == FOREST_OF_ACTION:
            # What is learned from the channels is the action, as if each step were an episode.
            steps = [
                Episode(state[None], action[:1])
                for episode in episodes
                for state, action in zip(episode.states, episode.actions, strict=True)
            ]
            found = _by_importance(steps, trial.seed)
        elif trial.method in (CONDITIONAL, CONDITIONAL_OF_ACTION):
            found = _by_conditional_importance(trial, episodes)
        else:
            found = _by_ours(trial, episodes)
    return Outcome(trial, tuple(found), time.perf_counter() - start)


def _by_ours(trial: Trial, episodes: list[Episode]) -> list[int]:
    if trial.method in SHUFFLED:
        states = exchange([e.states for e in episodes], np.random.default_rng([trial.seed, 3]))
        episodes = [Episode(s, e.rewards, e.actions) for s, e in zip(states, episodes, strict=True)]
    target = RETURN if trial.method == WARNING else SHUFFLED.get(trial.method, trial.method)
    selector = ConditionalMISelector(target=target, random_state=trial.seed)
    selector.fit(episodes, CONTROL_WORLDS[trial.scenario].channel_names)
    if trial.method == WARNING:
        return [1] if any("target 'action'" in text for text in selector.warnings_) else []
    return selector.get_support(indices=True).tolist()


def _by_importance(episodes: list[Episode], seed: int) -> list[int]:
    """Return all channels, the most important one first."""
    sensors = [(c,) for c in range(episodes[0].num_channels)]
    return np.argsort(-forest_importance(episodes, sensors, seed, 1)).tolist()


def _by_conditional_importance(trial: Trial, episodes: list[Episode]) -> list[int]:
    """Return the channels that predict the action, or beside action and step the return."""
    states = np.concatenate([e.states for e in episodes])
    actions = np.concatenate([e.actions for e in episodes])
    numbers = np.repeat(np.arange(len(episodes)), [len(e) for e in episodes])
    sensors = [(c,) for c in range(states.shape[1])]
    if trial.method == CONDITIONAL_OF_ACTION:
        return conditional_selection(states, actions[:, 0], numbers, sensors, trial.seed)
    steps = np.concatenate([np.arange(len(e)) for e in episodes])
    returns = np.concatenate([discounted_returns(e.rewards, _GAMMA) for e in episodes])
    inputs = np.column_stack([states, actions, steps])
    return conditional_selection(inputs, returns, numbers, sensors, trial.seed)


def exact(results: Results, world: str, method: str, target: str) -> str:
    """Return the share of trials that find exactly what a target needs; '' if there is none.

    A forest only ranks, and is told the number.
    """
    of_world = CONTROL_WORLDS[world]
    needed = {of_world.channel_names.index(name) for name in of_world.needed_for[target]}
    outcomes = results.of(world, method, of_world.num_episodes)
    count = len(needed) if method in (FOREST, FOREST_OF_ACTION) else None
    return _share([set(outcome.ranking[:count]) == needed for outcome in outcomes])


def _share(answers: list[bool]) -> str:
    return '{:.0%} ± {:.0%}'.format(*mean_and_error(answers)) if answers else ''


def table_of_targets(worlds: list[str], results: Results) -> str:
    """Return how often each target is given exactly what it needs, by ours and by peers."""
    rows = []
    for world in worlds:
        of_world = CONTROL_WORLDS[world]
        seconds = {
            target: np.median([o.seconds for o in results.of(world, target, of_world.num_episodes)])
            for target in (RETURN, *of_world.needed_for)
        }
        for target, needed in of_world.needed_for.items():
            if target == ACTION:
                peers = '', '', CONDITIONAL_OF_ACTION, FOREST_OF_ACTION
            elif target == RETURN:
                peers = RECURSIVE, KNOCKOFFS, CONDITIONAL, FOREST
            else:
                peers = RECURSIVE, KNOCKOFFS, '', FOREST
            asked = f'>= {ASKED[world, target]} %' if (world, target) in ASKED else 'to see'
            rows.append(
                (
                    *(world, of_world.num_episodes, target, ', '.join(needed) or 'nothing'),
                    *(asked, exact(results, world, target, target)),
                    *(exact(results, world, peer, target) for peer in peers),
                    f'{seconds[target]:.1f}',
                    f'{seconds[target] / seconds[RETURN]:.1f} (<= {1 + len(needed)})'
                    if target == DECISION
                    else '',
                )
            )
    head = (
        *('world', 'episodes', 'target', 'needed', 'asked', 'ours, exactly'),
        *('recursive extra trees, exactly', 'sequential knockoffs, exactly'),
        *('conditional importance, exactly', 'extra trees, told the number'),
        *('seconds', 'relative to return (asked)'),
    )
    return markdown_table(head, rows)


def table_of_errors(worlds: list[str], results: Results) -> str:
    """Return how often the return warns of a skilled controller, and what is found of nothing."""
    rows = []
    for world in worlds:
        outcomes = {
            method: [bool(o.ranking) for o in results.of(world, method, count)]
            for count in (CONTROL_WORLDS[world].num_episodes,)
            for method in (WARNING, *SHUFFLED)
        }
        rows.append((world, *(_share(found) for found in outcomes.values())))
    head = (
        *('world', 'the return warns of a skilled controller (100 %)'),
        *(f'{target}, shuffled: anything (<= 5 %)' for target in TARGETS),
    )
    return markdown_table(head, rows)


def run(options: argparse.Namespace) -> None:
    """Run the trials, then print the tables."""
    log = TrialLog(options.log)
    wanted = [
        Trial(
            world,
            question,
            CONTROL_WORLDS[world].num_episodes,
            number,
            options.first_seed + number,
        )
        for number in range(options.trials)
        for world in options.worlds
        for question in questions(world)
    ]
    results = finish(wanted, log, options.jobs, run=run_target)
    last = options.first_seed + options.trials - 1
    print(f'\n{options.trials} trials, seeds {options.first_seed} to {last}.\n')
    print(table_of_targets(options.worlds, results))
    print(table_of_errors(options.worlds, results), end='')


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    parser = study_parser('targets', __doc__, first_seed=1000)
    add_names(parser, '--worlds', CONTROL_WORLDS, CONTROL_WORLDS)
    add_log(parser)
    options = parser.parse_args(arguments)
    return exit_code('targets', lambda: run(options), kept(options.log))


if __name__ == '__main__':
    sys.exit(main())
