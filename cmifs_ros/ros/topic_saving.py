# SPDX-License-Identifier: Apache-2.0

"""Switching topics off: publication, the service to switch them on, and what it saves."""

from __future__ import annotations

import json

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from cmifs_ros.collect.sampling.saving import Saving
from cmifs_ros.collect.selection_fields import selection_of
from cmifs_ros.collect.traffic import TrafficMeter, rate_in_words, size_in_words

from . import diagnostics
from .qos import LATCHED_QOS


class TopicSaving:
    """Pass selections to `saving`; publish `switched_off`, serve `~/explore`, report savings.

    Parameters
    ----------
    node : rclpy.node.Node
    saving : Saving
    meter : TrafficMeter
        Measures the traffic of topics.

    """

    def __init__(self, node: Node, saving: Saving, meter: TrafficMeter):
        self._node, self._saving, self._meter = node, saving, meter
        self._told: frozenset[str] | None = None
        self._publisher = node.create_publisher(String, 'switched_off', LATCHED_QOS)
        node.create_subscription(String, 'selection', self._on_selection, LATCHED_QOS)
        node.create_service(Trigger, '~/explore', self._on_explore)
        self.tell()

    def tell(self) -> None:
        """Publish which topics are switched off, if they have changed."""
        off = self._saving.off
        if off != self._told:
            if self._told is not None:
                self._node.get_logger().info(self._saving.in_words())
            self._told = off
            names = sorted(set(map(self._node.resolve_topic_name, off)))
            self._publisher.publish(String(data=json.dumps(names)))

    def status(self) -> DiagnosticStatus:
        """Return its status, once a second."""
        saved = self._meter.saved
        messages = sum(of.messages for of in saved.values())
        values = {
            'topics switched off': len(self._saving.off),
            'messages saved': f'{messages:.0f}',
            'bytes saved': size_in_words(sum(of.bytes for of in saved.values())),
        }
        for what, is_saving in (('with all topics', False), ('while saving', True)):
            share = self._meter.cpu_share(is_saving)
            values |= {} if share is None else {f'CPU {what}': f'{share:.1%} of a core'}
        for topic, of in sorted(saved.items()):
            values[f'saved: {topic}'] = (
                f'{rate_in_words(self._meter.rate(topic))}; so far {of.messages:.0f} messages, '
                f'{size_in_words(of.bytes)}'
            )
        name = f'{diagnostics.name_of(self._node)}: saving'
        return diagnostics.status(name, diagnostics.OK, self._saving.in_words(), values)

    def _on_selection(self, message: String) -> None:
        try:
            self._saving.select(selection_of(json.loads(message.data)))
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError) as error:
            self._node.get_logger().warning(
                f'a selection cannot be read, so it switches no topic off: {error!r}'
            )

    def _on_explore(self, request, response):
        self._saving.explore('~/explore was called')
        response.success, response.message = True, self._saving.in_words()
        return response
