# SPDX-License-Identifier: Apache-2.0

"""A learner beside the selector, in one file: Q-learning on a table, on whatever is selected.

It subscribes to `selected_state` and `reward`, which belong together by their stamps, and publishes
`command`. It remembers values by the names of the sensors: when the selection changes, the table is
learned anew from these, on the sensors that are selected now. During the first episodes it
publishes nothing, and the robot's own policy acts. Prints the return of each episode.
"""

import random
import sys
from collections import OrderedDict, defaultdict, deque

import rclpy
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32

NUM_ACTIONS = 4
WARM_UP = 60  # episodes of the robot's own policy
GAMMA, STEP_SIZE, EPSILON = 0.95, 0.3, 0.1
REPLAYED = 30  # remembered steps that are learned again at each new one
SWEEPS = 10  # through all that is remembered, when the selection has changed
MAX_STEPS, MAX_UNPAIRED = 10_000, 1_000


class Learner:
    def __init__(self, node, num_episodes, seed):
        self.rng = random.Random(seed)
        self.num_episodes = num_episodes
        self.names = ()
        self.values = defaultdict(lambda: [0.0] * NUM_ACTIONS)  # by the selected values
        self.memory = deque(maxlen=MAX_STEPS)  # (state, action, reward, next state or None)
        self.states, self.rewards = OrderedDict(), OrderedDict()  # by stamp, until paired
        self.last = None  # (episode, step, state, action, reward), until the next state is known
        self.episode_return, self.finished = 0.0, 0
        self.publisher = node.create_publisher(Int32, 'command', 10)
        stream = QoSProfile(depth=1000)
        node.create_subscription(JointState, 'selected_state', self.on_state, stream)
        node.create_subscription(JointState, 'reward', self.on_reward, stream)

    def on_state(self, msg):
        if msg.name != list(self.names):
            self.names = tuple(msg.name)
            print(f'# sees {" ".join(self.names)}', flush=True)
            self.values.clear()
            for _ in range(SWEEPS):
                for step in self.rng.sample(self.memory, len(self.memory)):
                    self.learn(*step)
        state = dict(zip(msg.name, msg.position, strict=True))
        if self.finished >= WARM_UP:
            self.publisher.publish(Int32(data=self.act(state)))
        self.pair(msg, self.states, state)

    def on_reward(self, msg):
        self.pair(msg, self.rewards, dict(zip(msg.name, msg.position, strict=True)))

    def pair(self, msg, waiting, value):
        stamp = (msg.header.stamp.sec, msg.header.stamp.nanosec)
        waiting[stamp] = value
        if stamp in self.states and stamp in self.rewards:
            self.on_step(self.states.pop(stamp), self.rewards.pop(stamp))
        elif len(waiting) > MAX_UNPAIRED:
            waiting.popitem(last=False)

    def on_step(self, state, result):
        episode, step, reward = result['episode'], result['step'], result['reward']
        if self.last and self.last[:2] == (episode, step - 1):
            self.remember(*self.last[2:], state)
        self.last = (episode, step, state, int(result['action']), reward)
        self.episode_return += reward
        if result['terminated']:
            self.remember(*self.last[2:], None)
        if result['terminated'] or result['truncated']:
            print(f'{self.episode_return:g}', flush=True)
            self.episode_return = 0.0
            self.finished += 1

    def remember(self, *step):
        self.memory.append(step)
        self.learn(*step)
        for _ in range(REPLAYED):
            self.learn(*self.memory[self.rng.randrange(len(self.memory))])

    def learn(self, state, action, reward, reached):
        here, there = self.key(state), self.key(reached)
        if here is None or (reached is not None and there is None):
            return
        best = 0.0 if reached is None else max(self.values[there])
        values = self.values[here]
        values[action] += STEP_SIZE * (reward + GAMMA * best - values[action])

    def key(self, state):
        """Return the selected values of a state, or None if it lacks one of them."""
        if state is None or not all(name in state for name in self.names):
            return None
        return tuple(state[name] for name in self.names)

    def act(self, state):
        if self.rng.random() < EPSILON:
            return self.rng.randrange(NUM_ACTIONS)
        values = self.values[self.key(state)]
        best = max(values)
        return self.rng.choice([a for a in range(NUM_ACTIONS) if values[a] == best])


def main():
    num_episodes, seed = int(sys.argv[1]), int(sys.argv[2])
    # The signals end it at once, as before (studies/__init__.py): nothing needs to be saved.
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('learner')
    learner = Learner(node, num_episodes, seed)
    while learner.finished < num_episodes:
        rclpy.spin_once(node, timeout_sec=0.5)


if __name__ == '__main__':
    main()
