"""What the log says of the odometry's state."""

from __future__ import annotations

from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.odometry.depth_diagnosis import NO_POSE_YET
from rgbd_glue_ros.types import NANOSECONDS, OdometryEstimate, TrackingState


def log_state(node: BaseNode, before: TrackingState, estimate: OdometryEstimate, why: str) -> None:
    """Logs changes of state, and once for each cause why there is no first pose.

    Args:
        node: has the log, and a monitor that has taken the estimate.
        before: the state before the frame.
        estimate: of the frame.
        why: why it has no pose; "" if it has one.
    """
    if estimate.state is TrackingState.INITIALIZING:
        node.warn_once(NO_POSE_YET, why)
        return
    if estimate.is_start and before is not TrackingState.INITIALIZING:
        node.get_logger().warning(sentence(node.monitor.restarts.doubt))
        return
    if node.monitor.unseen_motion.since_ns == estimate.stamp_ns:
        node.get_logger().warning(sentence(node.monitor.unseen_motion.doubt))
    if estimate.state is before:
        return
    if estimate.state is TrackingState.LOST:
        node.get_logger().warning(
            f"Lost at {estimate.stamp_ns / NANOSECONDS:.3f} ({why}): no pose is published "
            "until the camera is found again"
        )
    elif before is TrackingState.INITIALIZING:
        node.get_logger().info(f"Tracking: first pose at {estimate.stamp_ns / NANOSECONDS:.3f}")
    elif before is TrackingState.LOST:
        node.get_logger().info(f"Tracking again at {estimate.stamp_ns / NANOSECONDS:.3f}")


def sentence(text: str) -> str:
    """A text with a capital first letter."""
    return f"{text[0].upper()}{text[1:]}"
