"""TF: looks up the camera on the robot and the pose of another odometry, and publishes the pose.

``tf2_ros`` is used if it is installed. ROS from PyPI does not include it: there the node reads
/tf and /tf_static itself if ``tf2_msgs`` can be imported, and otherwise does without TF.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Protocol

from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.monitor import Monitor
from rgbd_glue_ros.messages import making
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import plain_frame, stamp_ns
from rgbd_glue_ros.messages.transform_tree import HISTORY_NS, TF, TF_STATIC, TransformTree
from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.parameters import NodeConfig
from rgbd_glue_ros.types import Float64

if TYPE_CHECKING:
    from tf2_msgs.msg import TFMessage

# As in tf2.
TF_QOS = QoSProfile(depth=100)
TF_STATIC_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Period at which a waiting look-up polls tf2's buffer.
POLL_S = 0.005


class Transforms(Protocol):
    """Transforms received on TF."""

    def lookup(
        self, target: str, source: str, stamp_ns: int | None, timeout_s: float
    ) -> Float64 | None:
        """As ``TransformTree.lookup``; waits, so it must not be called in the executor's thread."""
        ...

    def time_went_back(self) -> None:
        """Has transforms from before a jump of time back, as of a bag, not hide those after it."""
        ...


def listen(node: BaseNode, config: NodeConfig) -> Transforms | None:
    """Listens to TF with what is installed, and logs how; None if that is impossible.

    The node's monitor counts how long look-ups wait.
    """
    transforms = _listen(node, config)
    return None if transforms is None else _TimedTransforms(transforms, node.monitor)


def _listen(node: Node, config: NodeConfig) -> Transforms | None:
    try:
        import tf2_ros  # noqa: PLC0415 - not part of ROS from PyPI
    except ImportError:
        pass
    else:
        node.get_logger().info("TF: read by tf2_ros")
        return _BufferedTransforms(node, tf2_ros)
    try:
        from tf2_msgs.msg import TFMessage  # noqa: PLC0415 - not part of ROS from PyPI
    except ImportError:
        node.get_logger().info(
            "TF: not available, since neither tf2_ros nor tf2_msgs is installed: in a clone "
            "scripts/tf2-msgs builds tf2_msgs, and ROS's own packages are ros-jazzy-tf2-ros-py "
            "and ros-jazzy-tf2-msgs"
        )
        return None
    node.get_logger().info("TF: read by the node itself, since tf2_ros is not installed")
    tree = TransformTree()

    def receive(message: TFMessage, *, is_static: bool) -> None:
        for transform in message.transforms:
            try:
                T = pose_from_message(transform, TF)
            except InputError:
                continue  # unusable
            head = transform.header
            stamp = None if is_static else stamp_ns(head.stamp)
            tree.add(plain_frame(head.frame_id), plain_frame(transform.child_frame_id), T, stamp)

    node.create_subscription(
        TFMessage, TF_STATIC, lambda m: receive(m, is_static=True), TF_STATIC_QOS
    )
    if _is_needed(config):
        node.create_subscription(TFMessage, TF, lambda m: receive(m, is_static=False), TF_QOS)
    return tree


def _is_needed(config: NodeConfig) -> bool:
    """Whether a transform may come on /tf, which is much traffic: not if parameters give all."""
    is_camera_given = not config.frame_id or config.camera_pose
    is_depth_given = config.depth_is_registered or config.depth_camera_pose
    return bool(
        config.guess_frame_id or not (is_camera_given and is_depth_given and config.imu_pose)
    )


class _TimedTransforms:
    """Transforms whose look-ups count in the monitor as time that frames waited for TF."""

    def __init__(self, transforms: Transforms, monitor: Monitor) -> None:
        self._transforms = transforms
        self._monitor = monitor

    def lookup(
        self, target: str, source: str, stamp_ns: int | None, timeout_s: float
    ) -> Float64 | None:
        start_ns = time.monotonic_ns()
        try:
            return self._transforms.lookup(target, source, stamp_ns, timeout_s)
        finally:
            if timeout_s:
                what = f"the transform from {source or 'images without a frame'} to {target}"
                self._monitor.waited(what, time.monotonic_ns() - start_ns)

    def time_went_back(self) -> None:
        self._transforms.time_went_back()


class _BufferedTransforms:
    """Transforms from tf2_ros's buffer and listener."""

    def __init__(self, node: Node, tf2_ros: Any) -> None:
        self._buffer = tf2_ros.Buffer(Duration(nanoseconds=HISTORY_NS))
        self._listener = tf2_ros.TransformListener(self._buffer, node)
        self._error = tf2_ros.TransformException

    def lookup(
        self, target: str, source: str, stamp_ns: int | None, timeout_s: float
    ) -> Float64 | None:
        # not the buffer's own wait, which uses a clock that may stand still
        end = time.monotonic() + timeout_s
        while True:
            found = self._lookup(target, source, stamp_ns)
            if found is not None or time.monotonic() >= end:
                return found
            time.sleep(POLL_S)

    def time_went_back(self) -> None:
        # static transforms stay; of others the buffer takes none that is older than its history
        self._buffer.clear()

    def _lookup(self, target: str, source: str, stamp_ns: int | None) -> Float64 | None:
        when = Time(nanoseconds=stamp_ns or 0)  # 0 means the newest
        try:
            found = self._buffer.lookup_transform(plain_frame(target), plain_frame(source), when)
        except self._error:
            return None
        return pose_from_message(found, TF)


class Broadcaster:
    """Publishes poses on /tf."""

    def __init__(self, node: Node) -> None:
        """Creates the publisher.

        Raises:
            ImportError: tf2_msgs is not installed.
        """
        from tf2_msgs.msg import TFMessage  # noqa: PLC0415 - not part of ROS from PyPI

        self._type = TFMessage
        self._publisher = node.create_publisher(TFMessage, TF, TF_QOS)

    def publish(self, parent: str, child: str, T_parent_child: Float64, stamp_ns: int) -> None:
        """Publishes the pose [4, 4] of a frame in another."""
        transform = TransformStamped(child_frame_id=child)
        making.copy_fields(making.header(stamp_ns, parent), transform.header)
        to, turn = transform.transform.translation, transform.transform.rotation
        to.x, to.y, to.z = (float(value) for value in T_parent_child[:3, 3])
        turn.x, turn.y, turn.z, turn.w = (float(v) for v in se3.quaternion(T_parent_child))
        self._publisher.publish(self._type(transforms=[transform]))
