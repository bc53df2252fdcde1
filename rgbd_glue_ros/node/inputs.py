"""The node's image and camera info subscriptions, with the QoS that their publishers offer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.arrivals import Arrivals
from rgbd_glue_ros.live.mixture import Mixture
from rgbd_glue_ros.live.transports import OtherTransport, other_transport
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.node.following import FollowingSubscription, offered_durability
from rgbd_glue_ros.node.publishers import (
    describe_mixture,
    describe_publishers,
    describe_qos,
    message_number,
)
from rgbd_glue_ros.node.runtime import say_later
from rgbd_glue_ros.parameters import NodeConfig

Receive = Callable[[Channel, Any], None]


class NodeInput:
    """A subscription with the reliability that its publishers offer, unless a parameter sets it.

    A reliable subscription gets nothing from a best-effort publisher, and a best-effort one may
    lose images of a reliable publisher.

    Attributes:
        channel: what the topic carries.
        topic: its full name, with the transport.
        arrivals: of its messages.
    """

    def __init__(
        self,
        node: Node,
        channel: Channel,
        message_type: type,
        topic: str,
        receive: Receive,
        config: NodeConfig,
        transport: str = topics.RAW,
    ) -> None:
        """Subscribes.

        Args:
            node: the node that subscribes.
            channel: what the topic carries.
            message_type: type of its messages.
            topic: its full name, without its transport.
            receive: called with each message.
            config: queue size and QoS.
            transport: of an image.
        """
        self.channel = channel
        self.arrivals = Arrivals()
        self._mixture = Mixture()
        self.topic = topics.transported(topic, transport)
        self._base, self._transport = topic, transport
        self._node = node
        self._receive = receive
        self._type = message_type
        self._depth = config.topic_queue_size
        self._parameter = "qos_camera_info" if channel is Channel.INFO else "qos"
        qos = config.qos_camera_info if channel is Channel.INFO else config.qos
        self._matches_publisher = qos == 0
        self._reliability = (
            ReliabilityPolicy.RELIABLE if qos == 1 else ReliabilityPolicy.BEST_EFFORT
        )
        self._subscription = FollowingSubscription(
            node,
            message_type,
            self.topic,
            self._take,
            self._qos(self._reliability, DurabilityPolicy.VOLATILE),
            self._wanted,
            self._say_change,
        )

    def _take(self, message: Any, info: dict[str, Any]) -> None:
        self.arrivals.add()
        self._mixture.add(message_number(info))
        self._receive(self.channel, message)

    def _qos(self, reliability: ReliabilityPolicy, durability: DurabilityPolicy) -> QoSProfile:
        return QoSProfile(depth=self._depth, reliability=reliability, durability=durability)

    def _wanted(self, publishers: list[TopicEndpointInfo]) -> QoSProfile:
        return self._qos(self._offered_reliability(publishers), offered_durability(publishers))

    def _say_change(self, qos: QoSProfile) -> None:
        self._node.get_logger().info(
            f"{self.topic}: subscribing as {describe_qos(qos)}, like its publisher"
        )

    def _offered_reliability(self, publishers: list[TopicEndpointInfo]) -> ReliabilityPolicy:
        """What all publishers offer, or what a parameter sets, which may match none of them."""
        offered = {info.qos_profile.reliability for info in publishers}
        best = (
            ReliabilityPolicy.RELIABLE
            if offered == {ReliabilityPolicy.RELIABLE}
            else ReliabilityPolicy.BEST_EFFORT
        )
        if self._matches_publisher:
            return best
        if best != self._reliability == ReliabilityPolicy.RELIABLE:
            say_later(self._node, self._refusal)
        return self._reliability

    def _refusal(self) -> str:
        return (
            f"{self.topic} is published by {', '.join(self.publishers)}, but "
            f"{self._node.get_fully_qualified_name()} subscribes as reliable "
            f"({self._parameter}:=1) and gets nothing from a best-effort publisher; "
            f"set {self._parameter} to 0"
        )

    @property
    def publishers(self) -> tuple[str, ...]:
        """Descriptions of the topic's publishers: node, type and reliability."""
        return describe_publishers(self._node, self.topic, self._type)

    def explain_mixture(self) -> str | None:
        """A warning if messages of several publishers came since the last call; None otherwise."""
        publishers = self.publishers
        is_mixed = self._mixture.judge(len(publishers))
        return describe_mixture(self.topic, publishers) if is_mixed else None

    @property
    def other(self) -> OtherTransport | None:
        """Where the same image is published in another transport, if it is not here."""

        def types_on(topic: str) -> list[str]:
            return [info.topic_type for info in self._node.get_publishers_info_by_topic(topic)]

        return other_transport(self.channel, self._base, self._transport, types_on)


def node_inputs(node: Node, config: NodeConfig, receive: Receive) -> tuple[NodeInput, ...]:
    """Subscribes to colour, depth and camera info; returns the inputs in this order."""
    transports = {
        Channel.COLOR: config.image_transport,
        Channel.DEPTH: config.depth_transport,
        Channel.INFO: topics.RAW,
    }
    inputs = []
    for channel, transport in transports.items():
        if channel is Channel.INFO:
            message_type: type = CameraInfo
        else:
            message_type = Image if transport == topics.RAW else CompressedImage
        # as in image_transport, users remap the base topic
        topic = node.resolve_topic_name(topics.SUBSCRIBED[channel])
        inputs.append(NodeInput(node, channel, message_type, topic, receive, config, transport))
    return tuple(inputs)
