# SPDX-License-Identifier: Apache-2.0

"""Saving: topics are really unsubscribed, come back, and nobody calls it a fault."""

import json
from dataclasses import replace

from selections import selection, sensor
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

from cmifs_ros.collect.selection_fields import fields_of
from cmifs_ros.ros.qos import LATCHED_QOS

FILE = """
step: {topic: /a}
channels: {a: /a.data, b: /b.data}
reward: a
episode: {steps: 5}
saving: {after: 2, explore_every: 120, explore_episodes: 2}
"""
STANDS = selection(
    sensor('a', is_selected=True, pvalue=0.01, status='confirmed'),
    sensor('b', pvalue=0.9, status='dispensable'),
    number=1,
)
OK = b'\x00'


class Surroundings:
    """A driver that publishes a topic only while somebody listens, and a selector's selections."""

    def __init__(self, robot):
        node, self._robot = robot.node, robot
        for unused in (robot.state_publisher, robot.reward_publisher):
            node.destroy_publisher(unused)
        self._drivers = [node.create_publisher(Float64, f'/{name}', 10) for name in 'ab']
        self._selections = node.create_publisher(String, 'selection', LATCHED_QOS)
        self.explore = node.create_client(Trigger, 'sampler/explore')
        self.off = []
        node.create_subscription(
            String, 'switched_off', lambda m: self.off.append(m.data), LATCHED_QOS
        )
        self._count = 0
        node.create_timer(0.02, self._drive)

    @property
    def listened_to(self):
        return [driver.get_subscription_count() > 0 for driver in self._drivers]

    def _drive(self):
        self._count += 1
        for driver, is_heard in zip(self._drivers, self.listened_to, strict=True):
            if is_heard:
                driver.publish(Float64(data=float(self._count)))

    def say(self, text):
        self._selections.publish(String(data=text))

    def select(self, number, **more):
        self.say(json.dumps(fields_of(replace(STANDS, number=number, **more))))

    def status(self, what):
        return self._robot.diagnostics.get(f'sampler: {what}', (None, '', {}))

    def dropped(self):
        """Return what the selector has dropped, by cause."""
        values = self._robot.diagnostics['selector: input'][2]
        return {key: count for key, count in values.items() if 'dropped' in key}


def test_what_is_dispensable_is_unsubscribed_and_comes_back(start, robot, tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text(FILE)
    sampler = start('sampler_node', robot_file=path)
    start('selector_node', selection_period=0.0)
    around = Surroundings(robot)
    status, select, off = around.status, around.select, around.off
    robot.until(lambda: 'selector: input' in robot.diagnostics)
    around.say('no selection')
    robot.until(lambda: 'so it switches no topic off' in sampler.output)
    select(1)
    robot.until(lambda: status('saving')[1].endswith('same selection 1 of 2 times'))
    robot.until(lambda: robot.value('episodes') >= 2)
    # The first episode may have begun before the selector listened.
    dropped_at_first = around.dropped()
    select(2)
    robot.until(lambda: around.listened_to == [True, False])
    robot.until(lambda: off == ['[]', '["/b"]'])
    # Neither node calls it a fault; and the controller has what it needs.
    silent = 'no episodes to learn from while /b is switched off'
    robot.until(lambda: robot.diagnostics['selector: input'][:2] == (OK, silent))
    robot.until(lambda: status('/b')[:2] == (OK, 'switched off'))
    robot.selected.clear()
    robot.until(lambda: len(robot.selected) > 20)
    assert {tuple(m.name) for m in robot.selected} == {('a',)}
    robot.until(lambda: int(status('saving')[2].get('messages saved', 0)) > 20)
    values = status('saving')[2]
    assert values['saved: /b'].split(' messages/s')[0] != '0'
    assert float(values['bytes saved'].split()[0]) > 0
    assert {'CPU with all topics', 'CPU while saving'} <= values.keys()

    # After as many episodes; then off again, after complete episodes that are learned from.
    before = robot.value('episodes')
    robot.until(lambda: around.listened_to == [True, True])
    robot.until(lambda: around.listened_to == [True, False])
    robot.until(lambda: robot.value('episodes') >= before + 2)
    assert off[:4] == ['[]', '["/b"]'] * 2
    robot.until(lambda: status('steps')[:2] == (OK, 'no steps to learn from without /b'))

    # When the data have changed, at once, and until two selections agree again.
    select(2, doubt='the data have changed since the selection: a')
    robot.until(lambda: around.listened_to == [True, True])
    said = 'all topics are on (the data have changed since the selection: a)'
    robot.until(lambda: status('saving')[1] == f'{said}: same selection 0 of 2 times')
    select(3)
    robot.until(lambda: status('saving')[1] == f'{said}: same selection 1 of 2 times')
    select(4)
    robot.until(lambda: around.listened_to == [True, False])

    # And when asked, until then, too.
    robot.until(around.explore.service_is_ready)
    reply = robot.call(around.explore)
    assert reply.success
    said = 'all topics are on (~/explore was called): same selection 0 of 2 times'
    assert reply.message == said
    robot.until(lambda: around.listened_to == [True, True])

    assert around.dropped() == dropped_at_first
    assert 'steps lack' not in sampler.output
    assert 'Traceback' not in sampler.output
