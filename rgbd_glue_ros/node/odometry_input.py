"""The mapping node's input from the odometry node, and what it logs if none arrives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.arrivals import Arrivals
from rgbd_glue_ros.live.odometry_faults import OdometryTopic, explain_no_keyframes
from rgbd_glue_ros.node.input_watch import LOOK_S
from rgbd_glue_ros.node.publishers import describe_publishers, publishing_nodes
from rgbd_glue_ros.node.silence import SilenceLog

# Queued messages of each topic, at most.
_QUEUE_SIZE = 100


@dataclass
class _Subscribed:
    """A topic, its messages, and how many of them came up to the last check."""

    topic: str
    type: type
    arrivals: Arrivals = field(default_factory=Arrivals)
    received_before: int = 0


class OdometryInput:
    """Subscriptions to poses, keyframes and edges, checked every ``LOOK_S``."""

    def __init__(
        self,
        node: Node,
        take_pose: Callable[[PoseStamped], None],
        take_keyframe: Callable[[PoseStamped], None],
        take_edge: Callable[[OdometryMessage], None],
        has_images: Callable[[], bool],
    ) -> None:
        """Subscribes.

        Args:
            node: subscribes, and provides the timer and the log.
            take_pose: called with the pose of each frame.
            take_keyframe: called with the pose of each keyframe.
            take_edge: called with each edge between keyframes.
            has_images: whether images have arrived; until then it is no fault that the odometry
                has nothing to say.
        """
        self._node = node
        self._silence_log = SilenceLog(node, "images")
        self._has_images = has_images
        # of messages that wait, rclpy takes those of the first subscription first: that a graph
        # begins is known before its first pose
        self._edge = self._subscribe(OdometryMessage, topics.KEYFRAME_EDGES, take_edge)
        self._keyframe = self._subscribe(PoseStamped, topics.KEYFRAME_POSE, take_keyframe)
        self._pose = self._subscribe(PoseStamped, topics.POSE, take_pose)
        # not the node's clock, since simulated time may stand still
        node.create_timer(LOOK_S, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def topics(self) -> tuple[str, ...]:
        """Full names of the subscribed topics."""
        return tuple(s.topic for s in (self._pose, self._keyframe, self._edge))

    @property
    def nodes(self) -> tuple[str, ...]:
        """Full names of the nodes that publish keyframes, as far as they are known."""
        return publishing_nodes(self._node, self._keyframe.topic)

    def _subscribe(self, kind: type, topic: str, take: Callable[[Any], None]) -> _Subscribed:
        subscribed = _Subscribed(self._node.resolve_topic_name(topic), kind)

        def receive(message: Any) -> None:
            subscribed.arrivals.add()
            take(message)

        self._node.create_subscription(kind, topic, receive, _QUEUE_SIZE)
        return subscribed

    def _look(self) -> None:
        """Logs why there are no keyframes."""
        subscribed = (self._pose, self._keyframe, self._edge)
        line = explain_no_keyframes(*map(self._seen, subscribed))
        self._pose.received_before = self._pose.arrivals.count
        self._silence_log.look(
            line,
            has_publishers=self._has_images(),
            has_messages=any(each.arrivals.count for each in subscribed),
        )

    def _seen(self, subscribed: _Subscribed) -> OdometryTopic:
        publishers = describe_publishers(self._node, subscribed.topic, subscribed.type)
        lately = subscribed.arrivals.count - subscribed.received_before
        nodes = publishing_nodes(self._node, subscribed.topic)
        last = str(subscribed.arrivals)
        return OdometryTopic(subscribed.topic, publishers, lately, last, nodes)
