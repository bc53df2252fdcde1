"""A camera and a listener in ROS, for tests that run the node over real DDS."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Trigger

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.live.topics import (
    DIAGNOSTICS,
    KEYFRAME_POSE,
    ODOM,
    POSE,
    SUBSCRIBED,
    transported,
)
from rgbd_glue_ros.messages import making
from rgbd_glue_ros.messages.making import copy_fields
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.types import NANOSECONDS, CameraIntrinsics, RgbdFrame

PATIENCE_S = 30.0
# A node that starts for the first time compiles, on a machine that may have other things to do.
START_S = 300.0
# The first stamp: an only image whose stamp is zero has no pose, since it may have no stamp.
START_NS = NANOSECONDS
OPTICAL_FRAME = "camera_color_optical_frame"


def corner_frame(stamp_ns: int, width: int = 320, height: int = 240) -> RgbdFrame:
    """A camera that looks into the corner of a room whose walls are covered with noise."""
    camera = CameraIntrinsics(width, height, width, width, (width - 1) / 2, (height - 1) / 2)
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    # walls |x| + z = 3 and a floor y + z / 2 = 1.5, whichever the ray meets first
    depth = np.minimum(3 / (np.abs(x) + 1), 1.5 / np.maximum(y + 0.5, 1e-3)).astype(np.float32)
    blocks = np.random.default_rng(0).integers(0, 255, (height // 4, width // 4, 3), np.uint8)
    color = np.kron(blocks, np.ones((4, 4, 1), np.uint8))
    return RgbdFrame(stamp_ns, color, depth, camera, OPTICAL_FRAME)


@dataclass
class Triple:
    """The messages of a frame."""

    color: Any
    depth: Any
    info: Any


def frame_messages(frame: RgbdFrame, *, is_compressed: bool) -> Triple:
    """A frame's three messages."""
    head = making.header(frame.stamp_ns, frame.frame_id)
    info = copy_fields(making.camera_info(frame.intrinsics, head), CameraInfo())
    depth_head = making.header(frame.stamp_ns + frame.depth_delay_ns, frame.frame_id)
    if is_compressed:
        color = making.compressed_color_image(frame.color, head)
        depth = making.compressed_depth_image(frame.depth, depth_head)
        return Triple(
            copy_fields(color, CompressedImage()), copy_fields(depth, CompressedImage()), info
        )
    return Triple(
        copy_fields(making.color_image(frame.color, head), Image()),
        copy_fields(making.depth_image(frame.depth, depth_head), Image()),
        info,
    )


class Rig(Closing):
    """Publishes frames and collects what the node answers.

    A context of its own keeps it apart from a node in the same process. All waiting is for events,
    and fails after PATIENCE_S.
    """

    def __init__(
        self,
        domain: int,
        *,
        compressed: bool = False,
        reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
        remapped: Mapping[Channel, str] = SUBSCRIBED,
    ) -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node("rig", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.is_compressed = compressed
        self._qos = QoSProfile(depth=10, reliability=reliability)
        image = CompressedImage if compressed else Image
        color, depth = remapped[Channel.COLOR], remapped[Channel.DEPTH]
        self.color = self.publisher(
            image, transported(color, "compressed") if compressed else color
        )
        self.depth = self.publisher(
            image, transported(depth, "compressedDepth") if compressed else depth
        )
        self.info = self.publisher(CameraInfo, remapped[Channel.INFO])
        self.poses: list[PoseStamped] = []
        self.keyframes: list[PoseStamped] = []
        self.odoms: list[OdometryMessage] = []
        self.diagnostics: list[DiagnosticArray] = []
        listened = (
            (PoseStamped, POSE, self.poses),
            (OdometryMessage, ODOM, self.odoms),
            (PoseStamped, KEYFRAME_POSE, self.keyframes),
            (DiagnosticArray, DIAGNOSTICS, self.diagnostics),
        )
        self._listeners = [
            self.node.create_subscription(kind, topic, received.append, 10)
            for kind, topic, received in listened
        ]

    def close(self) -> None:
        """Leaves the domain, as a driver that ends."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def publisher(self, kind: type, topic: str) -> Publisher:
        """A publisher with the rig's reliability."""
        return self.node.create_publisher(kind, topic, self._qos)

    def wait(
        self, condition: Callable[[], object], what: str, patience_s: float = PATIENCE_S
    ) -> None:
        """Handles events until ``condition`` holds."""
        deadline = time.monotonic() + patience_s
        while not condition():
            left = deadline - time.monotonic()
            assert left > 0, f"waited {patience_s} s in vain for {what}"
            # matches of other participants wake nothing here, so look for them now and then
            self._executor.spin_once(timeout_sec=min(left, 0.02))

    def spin_for(self, seconds: float) -> None:
        """Handles events for a while, as a driver between two frames."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def set_parameter(self, node: str, name: str, value: object) -> str:
        """Sets a parameter of a node; returns why that was refused, "" if it was not."""
        client = AsyncParameterClient(self.node, node)
        self.wait(client.services_are_ready, "the parameter services")
        change = client.set_parameters([Parameter(name, value=value)])
        self.wait(change.done, "the answer")
        (result,) = change.result().results
        return "" if result.successful else result.reason

    def wait_for_answer(self, node: str) -> None:
        """Asks a node for a parameter, so that it knows this rig's publishers once it has answered.

        A publisher knows a subscription of best effort before that knows the publisher, and what it
        sends in between is lost.
        """
        client = AsyncParameterClient(self.node, node)
        self.wait(client.services_are_ready, "the parameter services")
        asked = client.get_parameters(["use_sim_time"])
        self.wait(asked.done, "the answer")

    def trigger(self, service: str) -> Trigger.Response:
        """Calls a service, as ``/rgbd_odometry/save_graph``, and returns its answer."""
        client = self.node.create_client(Trigger, service)
        self.wait(client.service_is_ready, service)
        answer = client.call_async(Trigger.Request())
        self.wait(answer.done, f"the answer of {service}")
        response = answer.result()
        assert response is not None
        self.node.destroy_client(client)
        return response

    def wait_until_matched(self) -> None:
        """Waits until the node listens, with the reliability it settles on, and is listened to."""

        def is_matched() -> bool:
            for publisher in (self.color, self.depth, self.info):
                listeners = self.node.get_subscriptions_info_by_topic(publisher.topic_name)
                if [i.qos_profile.reliability for i in listeners] != [self._qos.reliability]:
                    return False
                if publisher.get_subscription_count() != 1:
                    return False
            # a publisher is in the graph before it is matched, and what it sends until then is lost
            return all(listener.get_publisher_count() == 1 for listener in self._listeners)

        self.wait(is_matched, "the node's subscriptions", START_S)

    def send(self, triple: Triple) -> None:
        """Publishes three messages."""
        self.color.publish(triple.color)
        self.depth.publish(triple.depth)
        self.info.publish(triple.info)

    def publish(self, frame: RgbdFrame) -> None:
        """Publishes a frame's three messages."""
        self.send(frame_messages(frame, is_compressed=self.is_compressed))

    def pose_of(self, frame: RgbdFrame) -> PoseStamped:
        """Publishes a frame and waits for its pose."""
        self.publish(frame)
        return self.pose_at(frame.stamp_ns)

    def publish_until_posed(self, frames: Iterator[RgbdFrame]) -> None:
        """Publishes frames until one has a pose: best effort may lose the first after a match."""
        while not self.poses:
            self.publish(next(frames))
            later = time.monotonic() + 0.5
            while not self.poses and time.monotonic() < later:
                self._executor.spin_once(timeout_sec=0.02)

    def pose_at(self, stamp_ns: int) -> PoseStamped:
        """Waits for the pose with this stamp."""
        stamp = making.header(stamp_ns, "").stamp

        def found() -> list[PoseStamped]:
            return [
                p
                for p in self.poses
                if (p.header.stamp.sec, p.header.stamp.nanosec) == (stamp.sec, stamp.nanosec)
            ]

        self.wait(found, f"the pose at {stamp_ns}")
        return found()[0]
