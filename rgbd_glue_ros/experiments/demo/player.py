"""Plays a recording to a node over DDS and receives its output; needs ROS."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.experiments.demo.played import Played, PlayedMessage, Sensor, Stream, transport
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.frame_counts import Summary
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.node.runtime import init_context
from rgbd_glue_ros.types import NANOSECONDS, Float64

MESSAGE_TYPES = {
    f"sensor_msgs/msg/{t.__name__}": t for t in (Image, CompressedImage, CameraInfo, Imu)
}
QUEUE = 10
# Queue size for an IMU, which has many samples between two images.
IMU_QUEUE = 1000
# A node that has not discovered this process after that does not exist.
LISTENERS_S = 5.0
# One of several nodes may discover it at once, another only with its next announcement.
ALL_FOUND_S = 3.0
# Subscriptions match one by one, are known here before they are there, and a node makes new ones by
# the QoS that it found.
SETTLED_S = 1.0
# Poses wait while messages are published; none may be lost, since they are counted.
ANSWERS = 1000


@dataclass(frozen=True)
class Listeners:
    """The subscribers of a camera.

    Attributes:
        nodes: their full names, sorted.
        unheard: topics of frames without a subscriber.
    """

    nodes: tuple[str, ...]
    unheard: tuple[str, ...]


class Camera(Closing):
    """Publishes a recording as a camera's driver would; a context manager.

    Attributes:
        topics: what is published, by channel, with the transport.
    """

    def __init__(
        self,
        recording: Played,
        domain: int | None = None,
        *,
        reliable: bool = True,
        ros_arguments: Sequence[str] = (),
    ) -> None:
        """Joins the domain.

        Args:
            recording: what to play.
            domain: ROS domain; None for the environment's.
            reliable: whether lost messages are resent; otherwise best effort.
            ros_arguments: remappings and others, without ``--ros-args``; as with the node, those
                of images have no transport.

        Raises:
            InputError: the ROS arguments are invalid.
        """
        self._recording = recording
        self._reliability = (
            ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        )
        self._context = Context()
        init_context(["--ros-args", *ros_arguments], context=self._context, domain_id=domain)
        self._node = Node("player", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._publishers = {
            channel: self._node.create_publisher(
                MESSAGE_TYPES[message_type],
                self._topic(channel, transport(recording, channel)),
                QoSProfile(
                    depth=IMU_QUEUE if channel is Sensor.IMU else QUEUE,
                    reliability=self._reliability,
                ),
            )
            for channel, message_type in recording.types.items()
        }
        self.topics = {channel: p.topic_name for channel, p in self._publishers.items()}

    def _topic(self, stream: Stream, image_transport: str) -> str:
        own = topics.IMU if isinstance(stream, Sensor) else topics.SUBSCRIBED[stream]
        return topics.transported(self._node.resolve_topic_name(own), image_transport)

    def close(self) -> None:
        """Leaves the domain."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Receives until ``condition`` holds or time is up; returns whether it holds."""
        end = time.monotonic() + timeout_s
        while not condition():
            left = end - time.monotonic()
            if left <= 0:
                return False
            # conditions may depend on events that wake nothing here, such as discovery
            self._executor.spin_once(timeout_sec=min(left, 0.05))
        return True

    def wait_for_listeners(self) -> Listeners:
        """Waits until all subscribers are matched, or until it is clear that there are none.

        That takes ``LISTENERS_S``, or ``SETTLED_S`` more if the first of them came late: nodes
        take a publisher that sends nothing for longer as a fault.
        """
        start = since = time.monotonic()
        known = self._subscriptions()

        def is_settled() -> bool:
            nonlocal known, since
            now = time.monotonic()
            if (found := self._subscriptions()) != known:
                known, since = found, now
            is_quiet = now - start >= ALL_FOUND_S and now - since >= SETTLED_S
            return is_quiet and not self._unheard()

        publishers = self._publishers.values()
        if not self.wait(lambda: any(p.get_subscription_count() for p in publishers), LISTENERS_S):
            return Listeners((), self._unheard())
        left_s = LISTENERS_S - (time.monotonic() - start)
        self.wait(is_settled, max(left_s, SETTLED_S))
        names = {name for _, name, _ in self._subscriptions()[0]}
        return Listeners(tuple(sorted(names)), self._unheard())

    def _unheard(self) -> tuple[str, ...]:
        return tuple(
            publisher.topic_name
            for stream, publisher in self._publishers.items()
            if isinstance(stream, Channel) and not publisher.get_subscription_count()
        )

    def _subscriptions(self) -> tuple[set[tuple[str, str, bytes]], list[int]]:
        """Topic, node and identity of each subscription, and the number of matches per topic."""
        found = {
            (
                p.topic_name,
                topics.full_name(info.node_namespace, info.node_name),
                bytes(info.endpoint_gid),
            )
            for p in self._publishers.values()
            for info in self._node.get_subscriptions_info_by_topic(p.topic_name)
        }
        return found, [p.get_subscription_count() for p in self._publishers.values()]

    def publish(self, message: PlayedMessage) -> None:
        """Publishes a message as it was recorded, byte for byte."""
        self._publishers[message.channel].publish(message.data)

    def play(
        self, rate: float, messages: Iterable[PlayedMessage] | None = None
    ) -> Iterator[PlayedMessage]:
        """Publishes all messages at ``rate`` times the recording's speed; yields each after that.

        Args:
            rate: 1 for the speed of the recording.
            messages: of the same channels, instead of the recording's.
        """
        start_ns = first_ns = None
        for message in self._recording.messages if messages is None else messages:
            if start_ns is None or first_ns is None:
                start_ns, first_ns = time.monotonic_ns(), message.recorded_ns
            due_ns = start_ns + (message.recorded_ns - first_ns) / rate
            is_due = False
            while not is_due:
                left_ns = due_ns - time.monotonic_ns()
                is_due = left_ns <= 0
                # even if it is late: otherwise answers would wait, and then be lost
                self._executor.spin_once(timeout_sec=max(0.0, left_ns / NANOSECONDS))
            self.publish(message)
            yield message


class Player(Camera):
    """A camera that receives the node's output.

    Attributes:
        published_ns: by stamp, when publication of the last message of a frame with it began,
            monotonic clock.
        frames_ns: stamps of the colour images published.
        poses: by stamp, the received poses [4, 4] of what was published.
        unassigned: number of poses with a stamp of nothing that was published.
        covariances: by stamp, those of the poses [6, 6].
        arrived_ns: by stamp, when the pose arrived, monotonic clock.
        keyframes: stamps of the frames that became keyframes.
        summary: the node's latest summary; None before the first.
    """

    def __init__(self, recording: Played, domain: int) -> None:
        """Joins the domain.

        Args:
            recording: what to play.
            domain: ROS domain.
        """
        super().__init__(recording, domain)
        self.published_ns: dict[int, int] = {}
        self.frames_ns: set[int] = set()
        self.poses: dict[int, Float64] = {}
        self.unassigned = 0
        self.covariances: dict[int, Float64] = {}
        self.arrived_ns: dict[int, int] = {}
        self.keyframes: set[int] = set()
        self.summary: Summary | None = None
        for kind, name, receive in (
            (PoseStamped, topics.POSE, self._receive_pose),
            (Odometry, topics.ODOM, self._receive_odometry),
            (PoseStamped, topics.KEYFRAME_POSE, self._receive_keyframe),
            (DiagnosticArray, topics.DIAGNOSTICS, self._receive_diagnostics),
        ):
            self._node.create_subscription(kind, name, receive, ANSWERS)

    def publish(self, message: PlayedMessage) -> None:
        """Publishes a message, and records the time."""
        if message.channel is not Sensor.IMU:
            # before publishing, since a node may receive it before this process continues
            self.published_ns[message.stamp_ns] = time.monotonic_ns()
        if message.channel is Channel.COLOR:
            self.frames_ns.add(message.stamp_ns)
        super().publish(message)

    def is_matched(self) -> bool:
        """Whether the node has subscribed to all topics, reliably to frames, and publishes."""
        for stream, publisher in self._publishers.items():
            listeners = self._node.get_subscriptions_info_by_topic(publisher.topic_name)
            is_reliable = [i.qos_profile.reliability for i in listeners] == [self._reliability]
            if isinstance(stream, Channel) and not is_reliable:
                return False
            if publisher.get_subscription_count() != 1:
                return False
        return all(self._node.count_publishers(t) == 1 for t in (topics.POSE, topics.KEYFRAME_POSE))

    def _receive_pose(self, message: PoseStamped) -> None:
        now_ns = time.monotonic_ns()
        stamp = stamp_ns(message.header.stamp)
        if stamp not in self.published_ns:
            self.unassigned += 1
            return
        self.poses[stamp] = pose_from_message(message, topics.POSE)
        self.arrived_ns[stamp] = now_ns

    def _receive_odometry(self, message: Odometry) -> None:
        covariance = np.array(message.pose.covariance, np.float64).reshape(6, 6)
        self.covariances[stamp_ns(message.header.stamp)] = covariance

    def _receive_keyframe(self, message: PoseStamped) -> None:
        self.keyframes.add(stamp_ns(message.header.stamp))

    def _receive_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.summary = Summary.parse({item.key: item.value for item in status.values})
