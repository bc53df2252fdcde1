"""Plays a recording to the node over DDS and listens to what it answers; needs ROS."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.monitor import Summary
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.recordings.bag.recording import BagRecording
from rgbd_glue_ros.types import NANOSECONDS, Float64, Trajectory

MESSAGE_TYPES = {f"sensor_msgs/msg/{t.__name__}": t for t in (Image, CompressedImage, CameraInfo)}
QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


@dataclass(frozen=True)
class PlayedMessage:
    """A message of a recording.

    Attributes:
        channel: what it carries.
        recorded_ns: when it was recorded, nanoseconds.
        stamp_ns: its header's stamp, nanoseconds.
        data: its CDR.
    """

    channel: Channel
    recorded_ns: int
    stamp_ns: int
    data: bytes


@dataclass(frozen=True)
class PlayedBag:
    """A bag in memory.

    Attributes:
        name: of the bag.
        types: of the messages of each channel.
        messages: in the order of recording.
        ground_truth: T_world_camera, None if the bag has none.
    """

    name: str
    types: dict[Channel, str]
    messages: tuple[PlayedMessage, ...]
    ground_truth: Trajectory | None

    @staticmethod
    def load(path: Path) -> PlayedBag:
        """Reads a rosbag2.

        Raises:
            InputError: it cannot be read, holds no RGB-D sequence, or is of ROS 1.
        """
        with BagRecording(path) as sequence:
            name, found, truth = sequence.name, sequence.topics, sequence.ground_truth
        channels = {
            found.color: Channel.COLOR,
            found.depth: Channel.DEPTH,
            found.info: Channel.INFO,
        }
        with BagFile(path) as bag:
            if bag.is_ros1:
                raise InputError(path, "is a ROS 1 bag", "convert it with `rgbd-glue convert`")
            types = {channel: bag.topics[str(topic)].type for topic, channel in channels.items()}
            messages = tuple(
                PlayedMessage(
                    channels[message.topic],
                    message.stamp_ns,
                    stamp_ns(bag.deserialize(message).header.stamp),
                    bytes(message.data),
                )
                for message in bag.messages([str(topic) for topic in channels])
            )
        return PlayedBag(name, types, messages, truth)

    @property
    def frame_count(self) -> int:
        """How many colour images it holds."""
        return sum(message.channel is Channel.COLOR for message in self.messages)

    def transport(self, channel: Channel) -> str:
        """The value of ``image_transport`` or ``depth_transport`` to receive this channel with."""
        if self.types[channel] != "sensor_msgs/msg/CompressedImage":
            return topics.RAW
        return "compressedDepth" if channel is Channel.DEPTH else "compressed"


class Player:
    """A camera that shows a recording; a context manager.

    Attributes:
        published_ns: by stamp, when publication of the last message with it began, monotonic clock.
        poses: by stamp, the poses [4, 4] that came.
        arrived_ns: by stamp, when the pose came, monotonic clock.
        keyframes: stamps of the frames that became keyframes.
        summary: what the node last said of itself; None before it did.
    """

    def __init__(self, recording: PlayedBag, domain: int) -> None:
        """Joins the domain.

        Args:
            recording: what is to be played.
            domain: ROS domain.
        """
        self.published_ns: dict[int, int] = {}
        self.poses: dict[int, Float64] = {}
        self.arrived_ns: dict[int, int] = {}
        self.keyframes: set[int] = set()
        self.summary: Summary | None = None
        self._recording = recording
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = Node("player", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._publishers = {
            channel: self._node.create_publisher(
                MESSAGE_TYPES[message_type],
                topics.transported(topics.SUBSCRIBED[channel], recording.transport(channel)),
                QOS,
            )
            for channel, message_type in recording.types.items()
        }
        for kind, name, receive in (
            (PoseStamped, topics.POSE, self._receive_pose),
            (PoseStamped, topics.KEYFRAME_POSE, self._receive_keyframe),
            (DiagnosticArray, topics.DIAGNOSTICS, self._receive_diagnostics),
        ):
            self._node.create_subscription(kind, name, receive, 10)

    def __enter__(self) -> Player:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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
            # conditions may depend on what wakes nothing here, as the discovery of others
            self._executor.spin_once(timeout_sec=min(left, 0.05))
        return True

    def is_matched(self) -> bool:
        """Whether the node listens to all topics, reliably, and publishes."""
        for publisher in self._publishers.values():
            listeners = self._node.get_subscriptions_info_by_topic(publisher.topic_name)
            if [i.qos_profile.reliability for i in listeners] != [QOS.reliability]:
                return False
            if publisher.get_subscription_count() != 1:
                return False
        return all(self._node.count_publishers(t) == 1 for t in (topics.POSE, topics.KEYFRAME_POSE))

    def publish(self, message: PlayedMessage) -> None:
        """Publishes a message as it was recorded, byte for byte."""
        # before, since a node may have it before this process goes on
        self.published_ns[message.stamp_ns] = time.monotonic_ns()
        self._publishers[message.channel].publish(message.data)

    def play(self, rate: float) -> Iterator[PlayedMessage]:
        """Publishes all messages at ``rate`` times the recording's speed; gives each after that."""
        messages = self._recording.messages
        start_ns = time.monotonic_ns()
        for message in messages:
            due_ns = start_ns + (message.recorded_ns - messages[0].recorded_ns) / rate
            while (left_ns := due_ns - time.monotonic_ns()) > 0:
                self._executor.spin_once(timeout_sec=left_ns / NANOSECONDS)
            self.publish(message)
            yield message

    def _receive_pose(self, message: PoseStamped) -> None:
        now_ns = time.monotonic_ns()
        stamp = stamp_ns(message.header.stamp)
        self.poses[stamp] = pose_from_message(message, topics.POSE)
        self.arrived_ns[stamp] = now_ns

    def _receive_keyframe(self, message: PoseStamped) -> None:
        self.keyframes.add(stamp_ns(message.header.stamp))

    def _receive_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.summary = Summary.parse({item.key: item.value for item in status.values})
