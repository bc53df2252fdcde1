"""The node, where tf2_ros is installed: what the node uses of it, with the rules of its buffer."""

import sys
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time
from tf2_msgs.msg import TFMessage

from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.messages.transform_tree import TF, TF_STATIC, TransformTree
from rgbd_glue_ros.node.node import main
from rgbd_glue_ros.node.tf import TF_QOS, TF_STATIC_QOS
from rigs.tf import transform


class UnknownTransformError(Exception):
    """A transform is unknown."""


class Buffer:
    """Ignores transforms that are older than the newest by more than its cache, until cleared."""

    def __init__(self, cache_time: Duration) -> None:
        self._cache_ns = cache_time.nanoseconds
        self._static: list[TransformStamped] = []
        self.clear()

    def clear(self) -> None:
        """Keeps static transforms."""
        self._tree = TransformTree()
        self._newest_ns: dict[str, int] = {}
        for message in self._static:
            self._add(message, None)

    def set_transform(self, message: TransformStamped) -> None:
        at_ns = stamp_ns(message.header.stamp)
        newest_ns = self._newest_ns.get(message.child_frame_id, at_ns)
        if at_ns >= newest_ns - self._cache_ns:
            self._newest_ns[message.child_frame_id] = max(newest_ns, at_ns)
            self._add(message, at_ns)

    def set_transform_static(self, message: TransformStamped) -> None:
        self._static.append(message)
        self._add(message, None)

    def _add(self, message: TransformStamped, at_ns: int | None) -> None:
        T = pose_from_message(message, TF)
        self._tree.add(message.header.frame_id, message.child_frame_id, T, at_ns)

    def lookup_transform(self, target: str, source: str, when: Time) -> TransformStamped:
        T = self._tree.lookup(target, source, when.nanoseconds or None, 0.0)
        if T is None:
            raise UnknownTransformError
        return transform(target, source, T)


class TransformListener:
    def __init__(self, buffer: Buffer, node: Node) -> None:
        def receive(message: TFMessage, add: Any) -> None:
            for each in message.transforms:
                add(each)

        node.create_subscription(TFMessage, TF, lambda m: receive(m, buffer.set_transform), TF_QOS)
        node.create_subscription(
            TFMessage, TF_STATIC, lambda m: receive(m, buffer.set_transform_static), TF_STATIC_QOS
        )


TF2_ROS = SimpleNamespace(
    Buffer=Buffer, TransformListener=TransformListener, TransformException=UnknownTransformError
)

if __name__ == "__main__":
    with patch.dict(sys.modules, {"tf2_ros": TF2_ROS}):
        sys.exit(main())
