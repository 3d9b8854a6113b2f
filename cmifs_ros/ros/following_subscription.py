# SPDX-License-Identifier: Apache-2.0

"""A subscription that adapts its QoS, so that it receives from every publisher of its topic."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

#: Seconds between checks of the publishers.
_LOOK_PERIOD = 0.5


class FollowingSubscription:
    """Subscribe to a topic with the strongest QoS that all its publishers offer.

    It is reliable only if all of them are, and transient local only if all are. Without a publisher
    it does not change; at first it is reliable and volatile. To change its QoS it is recreated:
    messages in transit at that moment may be lost, and latched ones may arrive twice.

    Parameters
    ----------
    node : rclpy.node.Node
        Owns the subscription and the timer that checks the publishers.
    message_type : type
    topic : str
    callback : callable
        Called with each message.
    depth : int
        Messages that may be queued for the callback.
    on_lost : callable, optional
        Called with the number of messages that the middleware reports as lost.
    on_matched : callable, optional
        Called when a publisher has come or gone.

    Attributes
    ----------
    topic_name : str
        The topic with its namespace, as remapped.
    publishers : list of str
        The publishing nodes, sorted, one entry for each publisher.
    clashes : dict of str to list of str
        By message type, if it differs from the subscription's, the nodes that publish this type.

    """

    def __init__(
        self,
        node: Node,
        message_type: type,
        topic: str,
        callback: Callable,
        *,
        depth: int = 1000,
        on_lost: Callable[[int], None] | None = None,
        on_matched: Callable[[], None] | None = None,
    ):
        self._node, self._message_type, self._topic = node, message_type, topic
        self._callback, self._on_lost, self._on_matched = callback, on_lost, on_matched
        self._type_name = f'{message_type.__module__.split(".")[0]}/msg/{message_type.__name__}'
        self._qos = QoSProfile(depth=depth)
        self.publishers: list[str] = []
        self.clashes: dict[str, list[str]] = {}
        self._subscription: Subscription | None = None
        self._num_matched = 0
        self.topic_name = node.resolve_topic_name(topic)
        self._follow()
        # Steady time: a paused simulation must not stop it.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_LOOK_PERIOD, self._follow, clock=clock)

    def destroy(self) -> None:
        """End the subscription and its timer."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self._subscription)

    def _subscribe(self) -> None:
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
        events = SubscriptionEventCallbacks(
            message_lost=self._on_message_lost,
            matched=self._on_publishers,
            use_default_callbacks=False,  # They would log what `_follow` resolves.
        )
        self._subscription = self._node.create_subscription(
            self._message_type, self._topic, self._callback, self._qos, event_callbacks=events
        )

    def _on_message_lost(self, event) -> None:
        if self._on_lost is not None:
            self._on_lost(event.total_count_change)

    @property
    def is_matched(self) -> bool:
        """Whether the subscription has a publisher, without delay."""
        return self._num_matched > 0

    def _on_publishers(self, event) -> None:
        self._num_matched = event.current_count
        if self._on_matched is not None:
            self._on_matched()

    def _follow(self) -> None:
        ours, clashes = [], {}
        for publisher in self._node.get_publishers_info_by_topic(self.topic_name):
            name = f'{publisher.node_namespace.rstrip("/")}/{publisher.node_name}'
            if publisher.topic_type == self._type_name:
                ours.append((name, publisher.qos_profile))
            else:
                clashes.setdefault(publisher.topic_type, []).append(name)
        self.publishers = sorted(name for name, _ in ours)
        self.clashes = {kind: sorted(names) for kind, names in clashes.items()}
        qos = self._qos_for([profile for _, profile in ours]) if ours else self._qos
        if self._subscription is None or qos != self._qos:
            self._qos = qos
            self._subscribe()

    def _qos_for(self, profiles: list[QoSProfile]) -> QoSProfile:
        reliability, durability = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
        if any(profile.reliability != reliability for profile in profiles):
            reliability = ReliabilityPolicy.BEST_EFFORT
        if any(profile.durability != durability for profile in profiles):
            durability = DurabilityPolicy.VOLATILE
        return QoSProfile(depth=self._qos.depth, reliability=reliability, durability=durability)
