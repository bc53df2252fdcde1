"""The node's publishers."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMessage
from nav_msgs.msg import Path
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Image

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.extrinsics import Extrinsics
from rgbd_glue_ros.live.keyframe_edges import edge_message, graph_start
from rgbd_glue_ros.live.match_image import match_image
from rgbd_glue_ros.live.odometry_message import odometry_message
from rgbd_glue_ros.messages import making
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.node.publishers import describe_node, describe_qos
from rgbd_glue_ros.node.runtime import say_later
from rgbd_glue_ros.node.tf import Broadcaster
from rgbd_glue_ros.parameters import NodeConfig
from rgbd_glue_ros.types import NANOSECONDS, Float64, OdometryEstimate, PoseGraphEdge, RgbdFrame

# The diagonal of both covariances if there is no pose, as in rtabmap_odom.
NULL_VARIANCE = 9999.0


@dataclass(frozen=True, eq=False)
class PublishedPose:
    """A pose, and the message in which it was published.

    Attributes:
        T_odom_child: float64 [4, 4].
        message: the same.
    """

    T_odom_child: Float64
    message: PoseStamped


class NodeOutputs:
    """Publishes the known parts of estimates; unknown ones are never invented."""

    def __init__(self, node: Node, config: NodeConfig, *, has_tf: bool) -> None:
        """Creates the publishers.

        Args:
            node: the node that publishes.
            config: what to publish, and in which frames.
            has_tf: whether /tf can be published.
        """
        self._node = node
        self._config = config
        # without a robot frame the child is the optical frame, whose parent comes from the driver
        does_broadcast = has_tf and config.publish_tf and config.frame_id
        self._broadcaster = Broadcaster(node) if does_broadcast else None
        self._pose = self._publisher(PoseStamped, topics.POSE)
        self._odom = self._publisher(OdometryMessage, topics.ODOM)
        self._keyframe = self._publisher(PoseStamped, topics.KEYFRAME_POSE)
        self._edges = self._publisher(OdometryMessage, topics.KEYFRAME_EDGES)
        self._path = self._publisher(Path, topics.PATH)
        self._matches = self._publisher(Image, topics.MATCHES)
        self._path_poses: deque[PoseStamped] = deque(maxlen=config.path_poses)

    def reconfigure(self, config: NodeConfig) -> None:
        """Applies changed parameters; fixed ones must be the same."""
        self._config = config

    def _publisher(self, message_type: type, topic: str) -> Publisher:
        def refusal() -> str:
            subscriptions = self._node.get_subscriptions_info_by_topic(publisher.topic_name)
            asked = ", ".join(
                f"{describe_node(i)} ({describe_qos(i.qos_profile)})" for i in subscriptions
            )
            return (
                f"{publisher.topic_name} is published as {describe_qos(publisher.qos_profile)}, "
                f"and a subscription that asks for more gets nothing; subscribed by {asked}"
            )

        # rclpy looks at every callback before each message that the node receives
        callbacks = PublisherEventCallbacks(
            incompatible_qos=lambda _: say_later(self._node, refusal), use_default_callbacks=False
        )
        publisher = self._node.create_publisher(message_type, topic, 10, event_callbacks=callbacks)
        return publisher

    def publish(
        self,
        estimate: OdometryEstimate,
        extrinsics: Extrinsics,
        frame: RgbdFrame,
        T_guess_child: Float64 | None,
    ) -> PublishedPose | None:
        """Publishes an estimate.

        Args:
            estimate: the estimate of ``frame``.
            extrinsics: between the camera and the published frames.
            frame: the frame.
            T_guess_child: pose [4, 4] of the child from another odometry; None if there is none.

        Returns:
            The published pose; None if there is none.
        """
        child = self._config.frame_id or frame.frame_id
        if estimate.T_odom_camera is None:
            if self._config.publish_null_when_lost:
                self._odom.publish(self._null(estimate.stamp_ns, child))
            return None
        head = making.header(estimate.stamp_ns, self._config.odom_frame_id)
        T_fixed_child = extrinsics.pose(estimate.T_odom_camera)
        _check(T_fixed_child, estimate.covariance, estimate.twist, estimate.twist_covariance)
        plain = making.pose_stamped(T_fixed_child, head)
        pose = making.copy_fields(plain, PoseStamped())
        self._broadcast(T_fixed_child, T_guess_child, estimate.stamp_ns)
        self._pose.publish(pose)
        odom = odometry_message(estimate, extrinsics, plain, child)
        if odom is not None:  # the first frame has no velocity
            self._odom.publish(making.copy_fields(odom, OdometryMessage()))
        self._extend_path(pose)
        return PublishedPose(T_fixed_child, pose)

    def publish_start(self, estimate: OdometryEstimate, extrinsics: Extrinsics) -> None:
        """Publishes that a pose graph begins with a frame; to be called before its pose is.

        Whoever listens then knows, as poses come, that they do not go on from those before.

        Args:
            estimate: of its first keyframe.
            extrinsics: between the camera and the published frames.
        """
        start = graph_start(estimate, extrinsics, self._config.odom_frame_id)
        if start is not None:
            self._edges.publish(making.copy_fields(start, OdometryMessage()))

    def publish_keyframe(self, pose: PublishedPose) -> None:
        """Publishes the pose of a frame that became a keyframe."""
        self._keyframe.publish(pose.message)

    def publish_edge(self, edge: PoseGraphEdge, stamp_ns: int) -> None:
        """Publishes the pose of a keyframe in another one, with its covariance.

        Args:
            edge: the edge between the published frames of the two keyframes.
            stamp_ns: stamp of the child, nanoseconds.
        """
        message = making.copy_fields(edge_message(edge, stamp_ns), OdometryMessage())
        self._edges.publish(message)

    def forget_path(self) -> None:
        """Starts a new path, as after a reset."""
        self._path_poses.clear()

    def _extend_path(self, pose: PoseStamped) -> None:
        """Adds a pose every ``path_period``, and publishes the path if it has a subscriber."""
        if self._path_poses:
            since_ns = stamp_ns(pose.header.stamp) - stamp_ns(self._path_poses[-1].header.stamp)
            if since_ns < self._config.path_period * NANOSECONDS:
                return
        self._path_poses.append(pose)
        if self._path.get_subscription_count():
            self._path.publish(Path(header=pose.header, poses=list(self._path_poses)))

    def show_matches(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Draws and publishes the matches if they have a subscriber."""
        if self._matches.get_subscription_count():
            head = making.header(estimate.stamp_ns, frame.frame_id)
            image = making.color_image(match_image(frame, estimate), head)
            self._matches.publish(making.copy_fields(image, Image()))

    def _broadcast(
        self, T_fixed_child: Float64, T_guess_child: Float64 | None, stamp_ns: int
    ) -> None:
        """Publishes on /tf such that every frame has a single parent."""
        config = self._config
        if self._broadcaster is None:
            return
        if not config.guess_frame_id:
            self._broadcaster.publish(
                config.odom_frame_id, config.frame_id, T_fixed_child, stamp_ns
            )
        elif T_guess_child is not None:
            T_odom_guess = T_fixed_child @ se3.inverse(T_guess_child)
            self._broadcaster.publish(
                config.odom_frame_id, config.guess_frame_id, T_odom_guess, stamp_ns
            )

    def _null(self, stamp_ns: int, child: str) -> OdometryMessage:
        """The message that rtabmap_odom publishes for a frame without a pose."""
        head = making.header(stamp_ns, self._config.odom_frame_id)
        odom = OdometryMessage()
        making.copy_fields(head, odom.header)
        odom.child_frame_id = child
        odom.pose.pose.orientation.w = 0.0
        odom.pose.covariance = odom.twist.covariance = np.diag([NULL_VARIANCE] * 6).ravel()
        return odom


def _check(*values: Float64 | None) -> None:
    """Refuses to publish values that are not finite, whatever their cause.

    Raises:
        InputError: a value is not finite.
    """
    if not all(value is None or np.isfinite(value).all() for value in values):
        raise InputError("the pose", "is not finite", "check the camera's pose on TF")
