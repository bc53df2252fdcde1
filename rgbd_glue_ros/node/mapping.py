"""The mapping node: closes loops over the odometry of another process, and publishes map -> odom.

It takes keyframes and their edges from the odometry node and the keyframes' images from the
camera. ``odom`` stays as smooth as it is; what a loop corrects is in ``map`` -> ``odom`` alone.
"""

from __future__ import annotations

import logging
import sys
import threading
from collections import OrderedDict, deque
from collections.abc import Sequence
from types import TracebackType
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMessage
from nav_msgs.msg import Path as PathMessage

from rgbd_glue_ros import parameters as cfg
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.user_paths import expanded, file_to_write
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.end_signals import EndSignals
from rgbd_glue_ros.live.keyframe_graph import moved_edge
from rgbd_glue_ros.live.monitor import Monitor
from rgbd_glue_ros.live.worker import QueueWorker
from rgbd_glue_ros.messages import fields
from rgbd_glue_ros.messages.frame import FrameTopics, frame_of_match
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.messages.stamps import StampSource
from rgbd_glue_ros.messages.synchronizer import Channel, Match, Synchronizer
from rgbd_glue_ros.node.depth_camera import DepthCameraInput
from rgbd_glue_ros.node.extrinsics import NodeExtrinsics
from rgbd_glue_ros.node.input_watch import NodeWatch
from rgbd_glue_ros.node.inputs import node_inputs
from rgbd_glue_ros.node.log import LoggedNode, RosLogHandler
from rgbd_glue_ros.node.odometry_input import OdometryInput
from rgbd_glue_ros.node.parameters import declare_parameters, follow_changes
from rgbd_glue_ros.node.runtime import run_node
from rgbd_glue_ros.node.saving import create_save_service
from rgbd_glue_ros.node.tf import Broadcaster, listen
from rgbd_glue_ros.slam.keyframe_stream import KeyframeStream, NewKeyframe
from rgbd_glue_ros.slam.live_map import Keyed, LiveMap
from rgbd_glue_ros.slam.map_file import SavedMap, read_map, write_map
from rgbd_glue_ros.types import NANOSECONDS, Float64, PoseGraphEdge, RgbdFrame

logger = logging.getLogger(f"{cfg.PACKAGE}.mapping")

NODE_NAME = "rgbd_mapping"
# Frames kept until the odometry says which of them are keyframes: two seconds of a usual camera.
FRAMES_KEPT = 60
KEYFRAMES_WAITING = 100
CLOSE_S = 4.0
# What keyframes are compared by holds for the whole map.
CHANGEABLE = ("save_map_file",)


class MappingNode(LoggedNode):
    """Publishes ``map`` -> ``odom`` and ``map/path``; a context manager, as it owns a thread."""

    def __init__(self) -> None:
        """Subscribes.

        Raises:
            InputError: a parameter has a value that it cannot have.
            MissingExtraError: the libraries of the extra slam are not installed.
        """
        super().__init__(NODE_NAME)
        self._log_handler = RosLogHandler(self)
        logging.getLogger(cfg.PACKAGE).addHandler(self._log_handler)
        self._config, config = declare_parameters(self, CHANGEABLE)
        self._config.check_map_frame()
        transforms = listen(self, self._config)
        self._extrinsics = NodeExtrinsics(self, self._config, transforms)
        self._map = LiveMap(config, _map_before(self._config))
        self._map_lock = threading.Lock()
        self._stream = KeyframeStream()
        self._monitor = Monitor()
        self._frames: OrderedDict[int, Match[Any]] = OrderedDict()
        self._synchronizer: Synchronizer[Any] = Synchronizer(
            round(self._config.max_interval_s * NANOSECONDS), self._config.sync_queue_size
        )
        self._depth_camera = DepthCameraInput(self, self._config, transforms)
        self._path = self.create_publisher(PathMessage, topics.MAP_PATH, 10)
        self._broadcaster = None if transforms is None else Broadcaster(self)
        # of a keyframe whose images are lost, no frame
        self._worker: QueueWorker[tuple[NewKeyframe, RgbdFrame | None] | PoseGraphEdge] = (
            QueueWorker(self._process, KEYFRAMES_WAITING)
        )
        self._waiting: deque[NewKeyframe | PoseGraphEdge] = deque()
        self._inputs = node_inputs(self, self._config, self._receive)
        self._odometry = OdometryInput(self, self._broadcast, self._take_keyframe, self._take_edge)
        NodeWatch(self, self._synchronizer, self._monitor, StampSource(cfg.HEADER), ()).start(
            self._inputs
        )
        create_save_service(self, topics.SAVE_MAP_SERVICE, "map", self._save_map)
        follow_changes(self, self._config, config, self._take_parameters, CHANGEABLE)
        self.get_logger().info(self._description())

    def __enter__(self) -> MappingNode:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Ends the thread."""
        ended = self._worker.close(CLOSE_S)
        logging.getLogger(cfg.PACKAGE).removeHandler(self._log_handler)
        if ended:
            self.destroy_node()

    def is_news(self, where: str, cause: str) -> bool:
        """Whether a fault deserves a line in the log."""
        return self._monitor.is_news(where, cause)

    def _take_parameters(self, config: cfg.NodeConfig, _: cfg.Config) -> None:
        self._config = config

    def _save_map(self) -> str:
        path = file_to_write(self._config.save_map_file, "save_map_file")
        with self._map_lock:
            saved = self._map.saved()
        if not len(saved):
            raise InputError(path, "there is no keyframe yet", "move the camera")
        write_map(path, saved)
        return f"{path}: {len(saved)} keyframes"

    # Input

    def _receive(self, channel: Channel, message: Any) -> None:
        at_ns = stamp_ns(message.header.stamp)
        for match in self._synchronizer.add(channel, at_ns, message):
            self._frames[match.stamp_ns] = match
            while len(self._frames) > FRAMES_KEPT:
                self._frames.popitem(last=False)
        self._submit([])

    def _take_keyframe(self, message: PoseStamped) -> None:
        at_ns = stamp_ns(message.header.stamp)
        T = pose_from_message(message, topics.KEYFRAME_POSE)
        self._submit(self._stream.add_pose(at_ns, T))

    def _take_edge(self, message: OdometryMessage) -> None:
        keyframes, late = self._stream.add_edge(
            stamp_ns(message.header.stamp), _edge_from_message(message)
        )
        self._submit([*keyframes, *([] if late is None else [late])])

    def _submit(self, items: Sequence[NewKeyframe | PoseGraphEdge]) -> None:
        """Leaves what came for the worker, as soon as its images are there."""
        self._waiting.extend(items)
        while self._waiting and not self._is_awaited(self._waiting[0]):
            item = self._waiting.popleft()
            if isinstance(item, PoseGraphEdge):
                self._worker.submit(item)
            else:
                self._submit_keyframe(item)

    def _is_awaited(self, item: NewKeyframe | PoseGraphEdge) -> bool:
        """Whether the images of a keyframe may yet come."""
        if isinstance(item, PoseGraphEdge) or item.stamp_ns in self._frames:
            return False
        return not self._frames or next(reversed(self._frames)) < item.stamp_ns

    def _submit_keyframe(self, keyframe: NewKeyframe) -> None:
        frame, match = None, self._frames.get(keyframe.stamp_ns)
        if match is None:
            self.get_logger().warning(
                f"Keyframe {keyframe.number} has no image at its stamp; it is left out"
            )
        else:
            try:
                frame = self._frame(match)
            except InputError as fault:
                if self.is_news(fault.where, fault.cause):
                    self.get_logger().error(str(fault))
        # its edge leads from the keyframe before to those that come, with images or without
        self._worker.submit((keyframe, frame))

    def _frame(self, match: Match[Any]) -> RgbdFrame:
        color, depth, info = (i.topic for i in self._inputs)
        names = FrameTopics(color, depth, info, self._depth_camera.topic)
        taken_by = self._depth_camera.of(match, names)
        return frame_of_match(match, names, taken_by, self._config.metres_per_unit)

    # Work, on the worker's thread

    def _process(self, item: tuple[NewKeyframe, RgbdFrame | None] | PoseGraphEdge) -> None:
        try:
            with self._map_lock:
                if isinstance(item, PoseGraphEdge):
                    self._add_edge(item)
                else:
                    self._add(*item)
        except InputError as fault:
            if self.is_news(fault.where, fault.cause):
                self.get_logger().error(str(fault))
        except Exception as error:
            if self.is_news("a keyframe", repr(error)):
                logger.exception("A keyframe could not be mapped; going on")

    def _add_edge(self, edge: PoseGraphEdge) -> None:
        extrinsics = self._extrinsics.known
        if extrinsics is not None:
            T_child_camera = se3.inverse(extrinsics.T_camera_child)
            self._map.add_edge(moved_edge(edge, T_child_camera))

    def _add(self, keyframe: NewKeyframe, frame: RgbdFrame | None) -> None:
        if keyframe.is_anew:
            self._map.clear()
        known = self._extrinsics.known
        extrinsics = known if frame is None else self._extrinsics.of(frame.frame_id)
        if extrinsics is None:
            return
        T_child_camera = se3.inverse(extrinsics.T_camera_child)
        edges = () if keyframe.edge is None else (moved_edge(keyframe.edge, T_child_camera),)
        if frame is None:
            self._map.skip(keyframe.number, edges)
            return
        before, was_placed = self._map.loops, self._map.is_placed
        keyed = Keyed(frame, keyframe.T_odom_child @ T_child_camera, edges)
        if self._config.localize_only:
            self._map.locate(keyed)
        else:
            self._map.add(keyframe.number, keyed)
        if self._map.is_placed and not was_placed:
            self.get_logger().info(f"Keyframe {keyframe.number} shows a place of the map")
        if self._map.loops > before:
            self.get_logger().info(
                f"Keyframe {keyframe.number}: {self._map.loops - before} loops closed, "
                f"{self._map.loops} in all"
            )
        self._publish_path(extrinsics.T_camera_child, keyframe.stamp_ns)

    def _publish_path(self, T_camera_child: Float64, at_ns: int) -> None:
        """Publishes all keyframes where the optimum has them."""
        if not self._path.get_subscription_count():
            return
        path, frame = PathMessage(), self._config.map_frame_id
        stamps = self._map.stamps_ns()
        fields.copy_fields(fields.header(at_ns, frame), path.header)
        path.poses = [
            fields.copy_fields(
                fields.pose_stamped(T @ T_camera_child, fields.header(stamps[row], frame)),
                PoseStamped(),
            )
            for row, T in sorted(self._map.poses.items())
        ]
        self._path.publish(path)

    def _broadcast(self, pose: PoseStamped) -> None:
        """Publishes map -> odom at the stamp of every pose, once it is known."""
        T_map_odom = self._map.T_map_odom
        if self._broadcaster is not None and T_map_odom is not None:
            at_ns = stamp_ns(pose.header.stamp)
            self._broadcaster.publish(
                self._config.map_frame_id, self._config.odom_frame_id, T_map_odom, at_ns
            )

    def _description(self) -> str:
        """What is subscribed and published."""
        subscribed = ", ".join([*(i.topic for i in self._inputs), *self._odometry.topics])
        path = self._path.topic_name
        frames = f"{self._config.map_frame_id} -> {self._config.odom_frame_id}"
        if self._broadcaster is None:
            published = f"{path} alone, since {frames} needs tf2_msgs"
        elif self._map.is_placed:
            published = f"{path} and {frames}"
        else:
            published = f"{path}, and {frames} once a place of the map is recognised"
        return f"Subscribed to {subscribed}; publishing {published}"


def _map_before(config: cfg.NodeConfig) -> SavedMap | None:
    """The map to begin with, if one is given.

    Raises:
        InputError: it cannot be read, or there is none where one is needed.
    """
    if config.map_file:
        return read_map(expanded(config.map_file, "map_file"))
    if config.localize_only:
        raise InputError("localize_only", "there is no map", "set map_file")
    return None


def _edge_from_message(message: OdometryMessage) -> PoseGraphEdge:
    """The edge that ``NodeOutputs.publish_edge`` put into a message.

    Raises:
        InputError: its pose or its covariance is none, or it is between no keyframes.
    """
    T = pose_from_message(message, topics.KEYFRAME_EDGES)
    parent, child = (
        topics.keyframe_number(name) for name in (message.header.frame_id, message.child_frame_id)
    )
    covariance = np.asarray(message.pose.covariance, np.float64).reshape(6, 6)
    if not (np.isfinite(covariance).all() and np.linalg.eigvalsh(covariance).min() > 0):
        raise InputError(
            topics.KEYFRAME_EDGES,
            "a covariance is not positive definite",
            "take the odometry node's",
        )
    return PoseGraphEdge(parent, child, T, se3.perturbation_covariance(T, covariance))


def main(args: list[str] | None = None, end_signals: EndSignals | None = None) -> int:
    """Runs the node until SIGINT or SIGTERM; arguments and exit code as of the odometry node."""
    return run_node(NODE_NAME, lambda _: MappingNode(), args, end_signals)


if __name__ == "__main__":
    sys.exit(main())
