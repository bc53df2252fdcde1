"""Subscriptions with the QoS that the publishers of their topic ask for.

Which that is becomes known only when a publisher appears, and another one may ask for another.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

Receive = Callable[[Any], None] | Callable[[Any, dict[str, Any]], None]


class FollowingSubscription:
    """Subscribes anew whenever the publishers of its topic ask for another QoS."""

    def __init__(
        self,
        node: Node,
        message_type: type,
        topic: str,
        receive: Receive,
        qos: QoSProfile,
        wanted: Callable[[list[TopicEndpointInfo]], QoSProfile],
        changed: Callable[[QoSProfile], None] = lambda _: None,
    ) -> None:
        """Subscribes.

        Args:
            node: the node that subscribes.
            message_type: type of the messages.
            topic: full name of the topic.
            receive: called with each message, and with its number and times if it takes these.
            qos: until the first publisher appears.
            wanted: the QoS for the publishers that there are; called when one comes or goes.
            changed: called with a new QoS, before it is used.
        """
        self._node = node
        self._type = message_type
        self._topic = topic
        self._receive = receive
        self._qos = qos
        self._wanted = wanted
        self._changed = changed
        self._subscription = self._subscribe()

    def _subscribe(self) -> Subscription:
        return self._node.create_subscription(
            self._type,
            self._topic,
            self._receive,
            self._qos,
            event_callbacks=SubscriptionEventCallbacks(
                matched=self._publishers_changed,
                # a publisher that offers less than those before does not match
                incompatible_qos=self._publishers_changed,
                # others would be looked at before each message that the node receives
                use_default_callbacks=False,
            ),
        )

    def _publishers_changed(self, _event: object) -> None:
        publishers = self._node.get_publishers_info_by_topic(self._topic)
        if not publishers:
            return
        qos = self._wanted(publishers)
        if qos == self._qos:
            return
        self._changed(qos)
        self._qos = qos
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._subscribe()


def offered_durability(publishers: list[TopicEndpointInfo]) -> DurabilityPolicy:
    """Transient local if all publishers offer it, so that earlier messages are received too."""
    offered = {info.qos_profile.durability for info in publishers}
    if offered == {DurabilityPolicy.TRANSIENT_LOCAL}:
        return DurabilityPolicy.TRANSIENT_LOCAL
    return DurabilityPolicy.VOLATILE
