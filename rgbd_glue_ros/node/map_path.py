"""The path of the mapping node: all keyframes at their optimum."""

from __future__ import annotations

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path as PathMessage
from rclpy.node import Node

from rgbd_glue_ros.live import topics
from rgbd_glue_ros.messages import making
from rgbd_glue_ros.slam.live_map import LiveMap
from rgbd_glue_ros.types import Float64


class MapPath:
    """Publishes ``map/path``."""

    def __init__(self, node: Node, frame_id: str) -> None:
        """Creates the publisher.

        Args:
            node: publishes.
            frame_id: of the map.
        """
        self._frame_id = frame_id
        self._publisher = node.create_publisher(PathMessage, topics.MAP_PATH, 10)

    @property
    def topic(self) -> str:
        """Full name of the topic."""
        return str(self._publisher.topic_name)

    def publish(self, live_map: LiveMap, T_camera_child: Float64, at_ns: int) -> None:
        """Publishes the poses of all keyframes, if there is a subscriber.

        Args:
            live_map: the map, which does not change meanwhile.
            T_camera_child: pose of the published frame in the optical frame, float64 [4, 4].
            at_ns: stamp of the path.
        """
        if not self._publisher.get_subscription_count():
            return
        path, frame = PathMessage(), self._frame_id
        stamps = live_map.stamps_ns()
        making.copy_fields(making.header(at_ns, frame), path.header)
        path.poses = [
            making.copy_fields(
                making.pose_stamped(T @ T_camera_child, making.header(stamps[row], frame)),
                PoseStamped(),
            )
            for row, T in sorted(live_map.poses.items())
        ]
        self._publisher.publish(path)
