# SPDX-License-Identifier: Apache-2.0

"""Faults injected into the selector, one per method."""

from __future__ import annotations

import os
import resource
import signal

import numpy as np
from std_srvs.srv import Trigger

from cmifs_ros.tools.program import CommandError
from studies.nodes.process import Process

from .messages import LENGTH, random_reward, random_state
from .part import Part
from .robot import Robot, robot_and


class Faults(Part):
    """Killed processes, bad messages, a full disk."""

    def calls(self):
        """Call the service a hundred times at once."""
        with robot_and(Process.selector(self.folder, selection_period=0.0)) as robot:
            robot.wait_for('selected_state')
            robot.run(1000, 50 * LENGTH)
            robot.until(lambda: robot.input.get('episodes') == '50', '50 episodes are there')
            answers = [robot.calls.call_async(Trigger.Request()) for _ in range(100)]
            robot.until(lambda: all(a.done() for a in answers), 'all calls are answered')
            replies = [a.result() for a in answers]
            yield (
                'concurrent calls of select_features',
                '100',
                f'{sum(r.success for r in replies)} answered with success, by '
                f'{len({r.message for r in replies})} computations',
            )

    def workers(self):
        """Kill the worker, idle and during a selection."""
        # The rewards count the messages, so old episodes do not fit new ones.
        process = Process.selector(
            self.folder, selection_period=0.0, num_features=3, forget_outdated=False
        )
        with robot_and(process) as robot:
            robot.wait_for('selected_state')
            robot.run(1000, 100 * LENGTH)
            robot.until(lambda: robot.input.get('episodes') == '100', '100 episodes are there')
            for state, times in (('idle', self.count(10)), ('computing', self.count(10))):
                told = recovered = 0
                for _ in range(times):
                    worker = self._idle_worker(robot)
                    answer = None
                    if state == 'computing':
                        answer = robot.calls.call_async(Trigger.Request())
                        robot.rest(0.3)  # It takes more than a second.
                    os.kill(worker, signal.SIGKILL)
                    if answer is None:
                        robot.until(lambda: robot.selection['worker pid'] == 'none', 'it is seen')
                        told += 1
                    else:
                        robot.until(answer.done, 'the call is answered')
                        told += 'the worker process died' in answer.result().message
                    recovered += robot.call().success
                yield (
                    f'worker killed (-9), {state}',
                    f'{times}',
                    f'{told} noticed, {recovered} next selections succeeded, '
                    f'{robot.input["episodes"]} of 100 episodes kept',
                )

    def _idle_worker(self, robot: Robot) -> int:
        """Return the process id of the worker once it is idle."""
        robot.diagnostics.clear()
        robot.until(
            lambda: (
                robot.selection.get('worker') == 'idle' and robot.selection['worker pid'] != 'none'
            ),
            'the worker is idle',
        )
        return int(robot.selection['worker pid'])

    def restarts(self):
        """Kill the selector at random moments and restart it."""
        path = self.folder / 'restarts'
        rng = np.random.default_rng(0)
        times, number, total, lost = self.count(20), 0, 0, []
        for _ in range(times):
            process = Process.selector(
                self.folder, selection_period=1.0, num_features=1, min_episodes=2,
                max_episodes=100_000, episodes_path=str(path), forget_outdated=False,
            )  # fmt: skip
            with robot_and(process) as robot:
                robot.number = number
                robot.wait_for('selected_state')
                kept = len(robot.numbers_in(path)) if path.exists() else 0
                if int(robot.input['episodes']) != kept:
                    raise CommandError(f'{kept} episodes were saved, but {robot.input} came back')
                robot.run(200, int(rng.integers(200, 800)))
                process.kill()
                # A transition was taken for sure if the state after the next one was relayed.
                finished = (robot.newest_relayed - 1) // LENGTH - number // LENGTH
                number = -(-robot.number // LENGTH) * LENGTH
            lost.append(max(0, finished - (len(robot.numbers_in(path)) - kept)))
            total += finished
        yield (
            'selector killed (-9) while collecting 200 transitions/s',
            f'{times}',
            f'{sum(lost)} finished episodes lost (at most {max(lost)} at once) of '
            f'{total}; all that came back were sent as they are',
        )

    def messages(self):
        """Lose, repeat and delay messages."""
        path = self.folder / 'messages'
        process = Process.selector(
            self.folder, selection_period=0.0, max_episodes=100_000, episodes_path=str(path)
        )
        rng = np.random.default_rng(0)
        with robot_and(process) as robot:
            robot.wait_for('selected_state')
            episodes = self.count(1000)
            late = []
            counts = {'dropped': 0, 'repeated': 0, 'delayed': 0}
            for _ in range(episodes * LENGTH):
                now, delayed = [], []
                for sent in zip((robot.states, robot.rewards), robot.transition(), strict=True):
                    fault = rng.choice([*counts, ''], p=[0.01, 0.01, 0.01, 0.97])
                    if fault:
                        counts[fault] += 1
                    now += {'dropped': 0, 'repeated': 2, 'delayed': 0, '': 1}[fault] * [sent]
                    delayed += [sent] * (fault == 'delayed')
                for publisher, msg in now + late:
                    publisher.publish(msg)
                late = delayed
                robot.rest(0.0005)
            robot.rest(3.0)
            kept = len(robot.numbers_in(path))
            drops = [int(n) for key, n in robot.input.items() if key.startswith('episodes dropped')]
            yield (
                'messages dropped, repeated, delayed past the next, 1 % each',
                ', '.join(f'{n} {what}' for what, n in counts.items()) + f' in {episodes} episodes',
                f'{kept} episodes collected, each as it was sent; {sum(drops)} counted as dropped',
            )

    def fuzz(self):
        """Send messages of the right type and arbitrary content."""
        total = self.count(100_000)
        rng = np.random.default_rng(0)
        process = Process.selector(self.folder, selection_period=0.5, forget_outdated=False)
        with robot_and(process) as robot:
            robot.wait_for('selected_state')
            for _ in range(total // 2):
                robot.states.publish(random_state(rng))
                robot.rewards.publish(random_reward(rng))
                robot.executor.spin_once(0)
            robot.rest(3.0)
            robot.call(robot.clear)
            before = int(robot.input['transitions'])
            robot.run(500, 25 * LENGTH)
            robot.until(lambda: robot.input.get('episodes') == '25', '25 episodes are there')
            success = robot.call().success
            causes = sum('messages dropped' in key for key in robot.input)
            yield (
                'random messages',
                f'{total}',
                f'no exception; {before} pairs made of them, {causes} causes counted; afterwards '
                f'25 of 25 episodes collected, selection {"succeeded" if success else "FAILED"}',
            )

    def disk(self):
        """Fill the disk and free it again."""
        path = self.folder / 'disk'
        process = Process.selector(self.folder, selection_period=0.0, episodes_path=str(path))
        with robot_and(process) as robot:
            robot.wait_for('selected_state')
            robot.run(500, 2 * LENGTH)
            robot.until(path.exists, 'a file is there')
            unlimited = resource.prlimit(process.pid, resource.RLIMIT_FSIZE)
            limit = (path.stat().st_size, unlimited[1])
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, limit)
            storage = 'selector: storage'
            robot.run(500, 50 * LENGTH)
            robot.until(lambda: robot.levels[storage][0] == b'\x02', 'the error is reported')
            told = robot.levels[storage][1].rpartition(': ')[2]
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, unlimited)
            robot.until(lambda: robot.levels[storage][0] == b'\x00', 'it is saved')
            yield (
                'no room for the file (RLIMIT_FSIZE)',
                'while 50 episodes came',
                f'reported ({told}); {len(robot.numbers_in(path))} of 52 episodes saved once there '
                'was room',
            )
