"""The depth camera of the node, for depth images that are not registered to colour."""

from __future__ import annotations

import threading
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import CameraInfo

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry.depth_registration import DepthCamera
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.messages.depth_camera import GivenDepthCamera, find_depth_camera
from rgbd_glue_ros.messages.frame import FrameTopics
from rgbd_glue_ros.messages.poses import pose_parameter
from rgbd_glue_ros.messages.synchronizer import Channel, Match
from rgbd_glue_ros.node.following import FollowingSubscription, offered_durability
from rgbd_glue_ros.node.tf import Transforms
from rgbd_glue_ros.parameters import NodeConfig
from rgbd_glue_ros.types import Float64

# How long the first frame waits for the camera info, since drivers send it after the image.
FIRST_INFO_S = 1.0


class DepthCameraInput:
    """Subscribes to the depth camera's info.

    Attributes:
        topic: full name of the camera info topic.
    """

    def __init__(self, node: Node, config: NodeConfig, transforms: Transforms | None) -> None:
        """Subscribes.

        Raises:
            InputError: ``depth_camera_pose`` cannot be read.
        """
        self.topic = _info_topic(node, config)
        self._node = node
        self._is_registered = config.depth_is_registered
        self._given = GivenDepthCamera(
            pose_parameter("depth_camera_pose", config.depth_camera_pose),
            is_info_chosen=bool(config.depth_info_topic),
        )
        self._transforms = transforms
        self._wait_s = config.wait_for_transform
        self._info: CameraInfo | None = None
        self._came = threading.Event()
        self._has_waited = self._has_noted = False
        self._subscription = FollowingSubscription(
            node, CameraInfo, self.topic, self._receive, _qos([]), _qos
        )

    def _receive(self, info: CameraInfo) -> None:
        self._info = info
        self._came.set()

    def of(self, match: Match[Any], names: FrameTopics) -> DepthCamera | None:
        """The camera that took the depth image; None if the image is registered to colour.

        Raises:
            InputError: the image is not registered, and the depth camera's intrinsics or its pose
                are unknown.
        """
        if self._is_registered:
            return None
        if not self._has_waited and self._node.count_publishers(self.topic) > 0:
            self._came.wait(FIRST_INFO_S)
            self._has_waited = True
        if self._given.is_info_chosen and self._info is None:
            raise InputError(
                self.topic,
                "no camera info was received, so the depth camera's intrinsics are unknown",
                "make the driver publish it, or leave depth_info_topic empty",
            )
        found = find_depth_camera(
            *(match.color, match.depth, match.info, self._info),
            self._find_transform,
            names,
            self._given,
        )
        if found.note is not None and not self._has_noted:
            self._has_noted = True
            self._node.get_logger().warning(found.note)
        return found.camera

    def _find_transform(self, color_frame: str, depth_frame: str) -> Float64 | None:
        if self._transforms is None:
            return None
        return self._transforms.lookup(color_frame, depth_frame, None, self._wait_s)


def _qos(publishers: list[TopicEndpointInfo]) -> QoSProfile:
    """Transient local if the info is offered so: it may be sent only once."""
    # best effort matches every publisher, and losing a single info does no harm
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=offered_durability(publishers),
    )


def _info_topic(node: Node, config: NodeConfig) -> str:
    """The given or remapped topic, otherwise the one beside the depth images."""
    if config.depth_info_topic:
        return str(node.resolve_topic_name(config.depth_info_topic))
    remapped = str(node.resolve_topic_name(topics.DEPTH_INFO))
    if remapped != node.resolve_topic_name(topics.DEPTH_INFO, only_expand=True):
        return remapped
    images = str(node.resolve_topic_name(topics.SUBSCRIBED[Channel.DEPTH]))
    beside = f"{images.rpartition('/')[0]}/camera_info"
    of_color = node.resolve_topic_name(topics.SUBSCRIBED[Channel.INFO])
    return remapped if beside == of_color else beside
