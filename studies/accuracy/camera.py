# SPDX-License-Identifier: Apache-2.0

"""How often a camera is confirmed beside joint states, and when it should not be.

An arm moves at random about its home, and is paid for being close to an object that drifts. The
camera shows the object as a bright blob, beside another blob that does not matter, under a light
that changes. In some recordings the joint states include the position of the object, in others
the camera is that of another robot.
"""

from __future__ import annotations

import argparse
import sys
from types import SimpleNamespace

import numpy as np

from cmifs_ros.collect.encoders import Image
from cmifs_ros.collect.sensor_groups import groups_by_name
from cmifs_ros.core import Episode
from cmifs_ros.core.selection import select
from cmifs_ros.core.statuses import STATUSES
from cmifs_ros.tools.program import CommandError, exit_code
from studies.trials.arguments import add_log, study_parser
from studies.trials.log import TrialLog
from studies.trials.parallel import finish
from studies.trials.statistics import mean_and_error
from studies.trials.tables import markdown_table
from studies.trials.trial import Outcome, Trial

NUM_EPISODES, NUM_STEPS, SIZE = 60, 25, 24
HIDDEN, GIVEN, ANOTHER = (
    'it alone shows the object', 'the joint states have the object, too', 'it is of another robot'
)  # fmt: skip
WORLDS = {'hidden': HIDDEN, 'given': GIVEN, 'another': ANOTHER}
_HOME = -0.5


def wandering(rng: np.random.Generator, width: int, memory: float = 0.9) -> np.ndarray:
    """Return an autoregressive series, shape (NUM_STEPS, width), of variance 1."""
    values = rng.normal(size=(NUM_STEPS, width))
    for step in range(1, NUM_STEPS):
        values[step] = memory * values[step - 1] + np.sqrt(1 - memory**2) * values[step]
    return values


def picture(rng: np.random.Generator, blobs: np.ndarray, light: float) -> SimpleNamespace:
    """Return a sensor_msgs/Image of blobs at some places, shape (n, 2), within -1 and 1."""
    axis = np.linspace(-1, 1, SIZE)
    shapes = np.exp(-((axis - blobs[:, :, None]) ** 2) / (2 * 0.15**2))  # (n, 2, SIZE)
    grey = light * (60 + 120 * np.einsum('nv,nh->vh', shapes[:, 1], shapes[:, 0]))
    pixels = np.clip(grey + rng.normal(0, 4, grey.shape), 0, 255).astype(np.uint8)
    return SimpleNamespace(
        height=SIZE, width=SIZE, encoding='mono8', is_bigendian=0, step=SIZE, data=pixels.tobytes()
    )


def recording(seed: int, kind: str) -> tuple[list[Episode], list[str]]:
    """Return the episodes of a recording, and the names of their channels."""
    rng, camera, episodes = np.random.default_rng(seed), Image(), []
    for _ in range(NUM_EPISODES):
        arm = _HOME + 0.3 * wandering(rng, 2)
        objects = np.clip(0.4 * wandering(rng, 2), -1, 1)
        distractor = np.clip(0.5 * wandering(rng, 2), -1, 1)
        light = 1 + 0.15 * wandering(rng, 1)[:, 0]
        seen = np.clip(0.4 * wandering(rng, 2), -1, 1) if kind == ANOTHER else objects
        views = [
            camera.encode(picture(rng, np.stack(blobs), max(0.3, bright)))
            for *blobs, bright in zip(seen, distractor, light, strict=True)
        ]
        states = [arm, objects, views] if kind == GIVEN else [arm, views]
        rewards = -np.hypot(*(arm - objects).T) + 0.1 * rng.normal(size=NUM_STEPS)
        episodes.append(Episode(np.hstack(states), rewards))
    names = ['arm_x', 'arm_y', *(('object_x', 'object_y') if kind == GIVEN else ())]
    return episodes, names + [f'camera{suffix}' for suffix in camera.suffixes]


def camera_of(trial: Trial) -> Outcome:
    """Return the status of the camera in a recording, as its place in `STATUSES`."""
    episodes, names = recording(trial.seed, WORLDS[trial.scenario])
    groups = groups_by_name(names)
    settings = {'groups': groups, 'random_state': trial.seed}
    found = select(episodes[: trial.episodes], names, 'conditional_mi', settings)
    (camera,) = (sensor for sensor in found.sensors if sensor.name == 'camera')
    return Outcome(trial, (STATUSES.index(camera.status),), found.seconds)


def run(options: argparse.Namespace) -> None:
    """Run the trials, then print the table."""
    try:
        log = TrialLog(options.log)
    except (OSError, ValueError) as error:
        raise CommandError(str(error)) from error
    last = options.first_seed + options.trials - 1
    wanted = [
        Trial(world, 'camera', NUM_EPISODES, number, options.first_seed + number)
        for number in range(options.trials)
        for world in WORLDS
    ]
    results = finish(wanted, log, options.jobs, run=camera_of)
    rows = []
    for world, kind in WORLDS.items():
        found = results.of(world, 'camera', NUM_EPISODES)
        shares = [
            '{:.0%} ± {:.0%}'.format(*mean_and_error([o.ranking == (i,) for o in found]))
            for i in range(len(STATUSES))
        ]
        rows.append((kind, *shares, f'{np.median([o.seconds for o in found]):.1f}'))
    print(f'\n{options.trials} recordings each, seeds {options.first_seed} to {last}.\n')
    print(markdown_table(('the camera', *STATUSES, 'seconds'), rows), end='')


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    parser = study_parser('camera', __doc__, trials=20, first_seed=1000)
    add_log(parser)
    options = parser.parse_args(arguments)
    kept = 'the same command continues where it stopped' if options.log else 'nothing is kept'
    return exit_code('camera', lambda: run(options), kept)


if __name__ == '__main__':
    sys.exit(main())
