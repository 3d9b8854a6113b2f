# SPDX-License-Identifier: Apache-2.0

"""The closed loop: simulator, selector and learner as processes; return per episode, in a plot.

The same learner learns with the selector in the loop, and without it on all channels.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from cmifs_ros.sim import SCENARIOS
from cmifs_ros.tools.arguments import file_to_write, number_from
from cmifs_ros.tools.processes import executable
from cmifs_ros.tools.program import CommandError, exit_code
from studies.trials.arguments import study_parser

#: Seconds a run may take beyond what its steps do.
_PATIENCE = 60.0
_STEPS = 20
#: Episodes over which the plot averages.
_WINDOW = 20
LABELS = {True: 'with the selector', False: 'on all channels'}


def run_loop(options: argparse.Namespace, seed: int, with_selector: bool) -> list[str]:
    """Run one loop to its end; return the lines of the learner."""
    # Neighbouring domains, so that no run hears the last messages of the one before.
    domain = (options.domain + 2 * (seed % 5) + with_selector) % 100
    environment = os.environ | {'ROS_DOMAIN_ID': str(domain)}
    learner = [sys.executable, '-m', 'studies.loop.learner', str(options.episodes), str(seed)]
    nodes = [
        [
            executable('simulator_node'), '--ros-args', '-p', 'policy:=topic',
            '-p', f'seed:={seed}', '-p', f'rate:={options.rate}',
            '-p', f'scenario:={options.scenario}',
        ]
    ]  # fmt: skip
    if with_selector:
        nodes.append(
            [
                executable('selector_node'), '--ros-args', '-p', 'selection_period:=5.0',
                '-p', f'num_features:={options.num_features}', '-p', 'min_episodes:=40',
            ]
        )  # fmt: skip
    else:
        learner += ['--ros-args', '-r', 'selected_state:=state']
    with ExitStack() as stack:
        output = stack.enter_context(tempfile.TemporaryFile('w+'))
        processes = []
        stack.callback(_end, processes)
        for command in (*nodes, learner):
            processes.append(
                subprocess.Popen(
                    command, env=environment, stdin=subprocess.DEVNULL, start_new_session=True,
                    stdout=output if command is learner else subprocess.DEVNULL,
                    stderr=None if command is learner else subprocess.DEVNULL,
                )
            )  # fmt: skip
        seconds = _PATIENCE + 2 * options.episodes * _STEPS / options.rate
        deadline = time.monotonic() + seconds
        while processes[-1].poll() is None:
            if time.monotonic() > deadline or any(p.poll() is not None for p in processes[:-1]):
                raise CommandError(f'the loop of seed {seed} did not end within {seconds:.0f} s')
            time.sleep(0.2)
        output.seek(0)
        return output.read().splitlines()


def _end(processes: list[subprocess.Popen]) -> None:
    for process in processes:
        process.terminate()
    for process in processes:
        try:
            process.wait(2)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def plot(returns: dict[bool, list[list[float]]], path: Path) -> None:
    """Save the running mean of the return per episode, each run thin, their mean thick."""
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4), layout='constrained')
    for (with_selector, runs), color in zip(returns.items(), ('tab:blue', 'tab:gray'), strict=True):
        window = np.ones(_WINDOW) / _WINDOW
        smooth = np.array([np.convolve(run, window, 'valid') for run in runs])
        episodes = np.arange(_WINDOW, len(runs[0]) + 1)
        axes.plot(episodes, smooth.T, color=color, linewidth=0.6, alpha=0.6)
        axes.plot(episodes, smooth.mean(axis=0), color=color, label=LABELS[with_selector])
    axes.set_xlabel('episode')
    axes.set_ylabel(f'return, mean of the last {_WINDOW} episodes')
    axes.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def run(options: argparse.Namespace) -> None:
    """Run both loops for each seed, then print and plot."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    returns: dict[bool, list[list[float]]] = {True: [], False: []}
    for seed in range(options.trials):
        for with_selector, runs in returns.items():
            lines = run_loop(options, seed, with_selector)
            runs.append([float(line) for line in lines if not line.startswith('#')])
            last = np.mean(runs[-1][-50:])
            print(f'seed {seed}, {LABELS[with_selector]}: the last 50 episodes return {last:.2f}')
            for line in lines:
                if line.startswith('#'):
                    print(f'  {line[2:]}', flush=True)
    plot(returns, options.out)
    print(f'{options.out}')


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options; an invalid one ends the program with a message."""
    parser = study_parser('closed_loop', __doc__, trials=3, has_jobs=False)
    parser.add_argument('--scenario', choices=SCENARIOS, default='without_gravel')
    parser.add_argument('--episodes', type=number_from(100), default=300, help='default 300')
    parser.add_argument(
        '--num-features', type=number_from(0), default=0, help='0: automatic (the default)'
    )
    parser.add_argument('--rate', type=float, default=100.0, help='steps per second (default 100)')
    parser.add_argument(
        '--domain', type=number_from(0), default=int(os.environ.get('ROS_DOMAIN_ID', '80')),
        help='first of the ROS domains used (default ROS_DOMAIN_ID, else 80)',
    )  # fmt: skip
    parser.add_argument('--out', type=file_to_write, default=Path('loop/returns.png'))
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Run the loops; return the exit code."""
    options = parse(arguments)
    return exit_code('closed_loop', lambda: run(options))


if __name__ == '__main__':
    sys.exit(main())
