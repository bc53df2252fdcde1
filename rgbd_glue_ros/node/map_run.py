"""The mapping node once it has a map: adds keyframes to it, and publishes what follows."""

from __future__ import annotations

import threading
from typing import Any

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMessage

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.user_paths import file_to_write
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.extrinsics import Extrinsics
from rgbd_glue_ros.live.keyframe_edges import begins_graph, edge_from_message
from rgbd_glue_ros.live.keyframe_graph import moved_edge
from rgbd_glue_ros.live.map_summary import (
    DroppedMap,
    EndedMap,
    describe_dropped,
    describe_end,
    describe_left_out,
)
from rgbd_glue_ros.live.worker import QueueWorker
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.messages.synchronizer import Match
from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.node.extrinsics import NodeExtrinsics
from rgbd_glue_ros.node.keyframe_matching import (
    KEYFRAMES_WAITING,
    KeyframeMatching,
    MatchedKeyframe,
    NewGraph,
)
from rgbd_glue_ros.node.map_path import MapPath
from rgbd_glue_ros.node.mapping_diagnostics import MappingDiagnostics
from rgbd_glue_ros.node.odometry_input import OdometryInput
from rgbd_glue_ros.node.rgbd_input import RgbdInput
from rgbd_glue_ros.node.tf import Broadcaster
from rgbd_glue_ros.parameters import NodeConfig
from rgbd_glue_ros.slam.keyframe_stream import NewKeyframe
from rgbd_glue_ros.slam.live_map import LiveMap, PublishedKeyframe
from rgbd_glue_ros.slam.map_saving import MapSaving
from rgbd_glue_ros.slam.unrecognised import Unrecognised
from rgbd_glue_ros.types import PoseGraphEdge, RgbdFrame


class MapRun:
    """Publishes ``map`` -> ``odom`` and ``map/path``."""

    def __init__(
        self,
        node: BaseNode,
        config: NodeConfig,
        live_map: LiveMap,
        images: RgbdInput,
        extrinsics: NodeExtrinsics,
        broadcaster: Broadcaster | None,
    ) -> None:
        """Subscribes to the odometry, and publishes.

        Args:
            node: subscribes, publishes, and has the log.
            config: frames, and whether the map is changed.
            live_map: the map.
            images: those of the camera; the owner passes them to ``take_images``.
            extrinsics: of the camera.
            broadcaster: to /tf; None if there is none.
        """
        self._node = node
        self._config = config
        self._map = live_map
        self._input = images
        self._extrinsics = extrinsics
        self._broadcaster = broadcaster
        self._map_lock = threading.Lock()
        self._saving = MapSaving()
        self._unrecognised = Unrecognised()
        self._path = MapPath(node, config.map_frame_id)
        self._worker: QueueWorker[NewGraph | MatchedKeyframe | PoseGraphEdge] = QueueWorker(
            self._process, KEYFRAMES_WAITING
        )
        # the one that poses are of, and the one that the map is of, which may be behind
        self._tracked_graph: NewGraph | None = None
        self._mapped_graph: NewGraph | None = None
        self._matching = KeyframeMatching(node, images, lambda: self._odometry.nodes, self._submit)
        self._odometry = OdometryInput(
            node,
            self._take_pose,
            self._take_keyframe,
            self._take_edge,
            lambda: images.has_received,
        )
        self._diagnostics = MappingDiagnostics(
            node, live_map, images.watch, lambda: len(self._matching) + len(self._worker)
        )

    def close(self, timeout_s: float) -> bool:
        """Finishes the current keyframe; returns whether that took less than ``timeout_s``."""
        return self._worker.close(timeout_s)

    def say_what_is_left(self) -> None:
        """Logs what the map holds in the end, and whether it is saved."""
        given = self._map.given
        ended = EndedMap(
            len(self._map.poses),
            self._map.loops,
            self._saving.state,
            given="" if given is None else given.name,
            keyframes_given=0 if given is None else len(given),
            waiting=self._map.waiting_keyframes,
        )
        self._node.get_logger().info(describe_end(ended, self._save_service))

    @property
    def _save_service(self) -> str:
        return str(self._node.resolve_service_name(topics.SAVE_MAP_SERVICE))

    def save(self, file: str) -> str:
        """Saves the map.

        Args:
            file: the value of ``save_map_file``.

        Returns:
            What was saved where.

        Raises:
            InputError: it is empty, does not change, or cannot be written.
        """
        if self._config.localize_only:
            cause = "is true, so the map does not change and there is nothing to save"
            remedy = f"it is in {self._config.map_file}; to add to it, start without localize_only"
            raise InputError("localize_only", cause, remedy)
        path = file_to_write(file, "save_map_file")
        with self._map_lock:
            # of this map, even if another begins while the file is written
            saved, saving = self._map.saved(), self._saving
            left_out = describe_left_out(self._map.waiting_keyframes)
        if not len(saved):
            raise InputError(path, "there is no keyframe yet", "move the camera")
        return saving.save(path, saved) + left_out

    # Input

    def take_images(self, match: Match[Any]) -> None:
        """Takes the images of a frame."""
        self._matching.add_images(match)

    def _take_pose(self, pose: PoseStamped) -> None:
        self._matching.track(stamp_ns(pose.header.stamp))
        self._broadcast(pose)

    def _take_keyframe(self, message: PoseStamped) -> None:
        at_ns = stamp_ns(message.header.stamp)
        self._matching.add_pose(at_ns, pose_from_message(message, topics.KEYFRAME_POSE))

    def _take_edge(self, message: OdometryMessage) -> None:
        at_ns = stamp_ns(message.header.stamp)
        if begins_graph(message):
            self._matching.begin(at_ns)
        else:
            self._matching.add_edge(at_ns, edge_from_message(message))

    def _submit(self, item: NewGraph | MatchedKeyframe | PoseGraphEdge) -> None:
        if isinstance(item, NewGraph):
            self._tracked_graph = item
        self._worker.submit(item)

    # Work, on the worker's thread

    def _process(self, item: NewGraph | MatchedKeyframe | PoseGraphEdge) -> None:
        try:
            if isinstance(item, MatchedKeyframe):
                self._add(item)
            elif isinstance(item, PoseGraphEdge):
                self._add_edge(item)
            else:
                self._begin_anew(item)
        except InputError as fault:
            self._node.report(fault)
        except Exception as error:
            self._node.report_failure("A keyframe could not be mapped", error)

    def _begin_anew(self, graph: NewGraph) -> None:
        """Starts another map, and says what becomes of the one before."""
        # the odometry may have restarted with another camera
        self._extrinsics.forget()
        with self._map_lock:
            said = describe_dropped(self._dropped(), self._save_service)
            self._map.clear()
            self._mapped_graph = graph
            self._unrecognised.recognised()
            self._saving = MapSaving()
        if said:
            self._node.get_logger().warning(said)

    def _dropped(self) -> DroppedMap:
        """What there is before another map begins."""
        given, count = self._map.given, self._map.session_keyframes
        if given is None:
            return DroppedMap(count, self._saving.state)
        is_placed = self._map.is_placed
        return DroppedMap(count, self._saving.state, given.name, len(given), is_placed)

    def _frame(self, item: MatchedKeyframe) -> RgbdFrame | None:
        """The images of a keyframe; None if they are missing or unusable."""
        if item.match is None:
            return None
        try:
            return self._input.frame(item.match)
        except InputError as fault:
            self._node.report(fault)
            return None

    def _add_edge(self, edge: PoseGraphEdge) -> None:
        extrinsics = self._extrinsics.known
        if extrinsics is not None:
            T_child_camera = se3.inverse(extrinsics.T_camera_child)
            with self._map_lock:
                self._map.add_edge(moved_edge(edge, T_child_camera))
                stamps = self._map.stamps_ns()
                if stamps:
                    at_ns = stamps[max(stamps)]
                    self._path.publish(self._map, extrinsics.T_camera_child, at_ns)

    def _add(self, item: MatchedKeyframe) -> None:
        # both may wait for TF, so the lock is not held
        frame = self._frame(item)
        known = self._extrinsics.known
        extrinsics = known if frame is None else self._extrinsics.of(frame.frame_id)
        if extrinsics is not None:
            with self._map_lock:
                self._add_to_map(item.keyframe, frame, extrinsics)

    def _add_to_map(
        self, keyframe: NewKeyframe, frame: RgbdFrame | None, extrinsics: Extrinsics
    ) -> None:
        T_child_camera = se3.inverse(extrinsics.T_camera_child)
        edges = () if keyframe.edge is None else (moved_edge(keyframe.edge, T_child_camera),)
        if frame is None:
            if not self._config.localize_only:
                self._map.skip(keyframe.number, edges)
            return
        before, was_placed = self._map.loops, self._map.is_placed
        keyed = PublishedKeyframe(frame, keyframe.T_odom_child @ T_child_camera, edges)
        if self._config.localize_only:
            self._map.locate(keyed)
        else:
            self._map.add(keyframe.number, keyed)
        self._diagnostics.mapped()
        if self._map.is_placed and not was_placed:
            self._node.get_logger().info(f"Keyframe {keyframe.number} shows a known place")
        self._say_if_unrecognised()
        if self._map.loops > before:
            self._node.get_logger().info(
                f"Keyframe {keyframe.number}: {self._map.loops - before} loops closed, "
                f"{self._map.loops} in total"
            )
        self._path.publish(self._map, extrinsics.T_camera_child, keyframe.stamp_ns)

    def _say_if_unrecognised(self) -> None:
        """Warns, from time to time, if keyframes show no place of a given map."""
        given = self._map.given
        if given is None or self._map.is_placed:
            self._unrecognised.recognised()
            return
        said = self._unrecognised.add(given.name, len(given))
        if said:
            self._node.get_logger().warning(said)

    def _broadcast(self, pose: PoseStamped) -> None:
        """Publishes map -> odom at the stamp of a pose, once the transform is known."""
        if self._mapped_graph is not self._tracked_graph:
            return  # what the map has is of the odom before
        T_map_odom = self._map.T_map_odom
        if self._broadcaster is not None and T_map_odom is not None:
            at_ns = stamp_ns(pose.header.stamp)
            self._broadcaster.publish(
                self._config.map_frame_id, self._config.odom_frame_id, T_map_odom, at_ns
            )

    @property
    def description(self) -> str:
        """What the node subscribes to and publishes."""
        subscribed = ", ".join([*self._input.topics, *self._odometry.topics])
        path = self._path.topic
        frames = f"{self._config.map_frame_id} -> {self._config.odom_frame_id}"
        if not self._config.publish_tf:
            published = f"{path} only, since publish_tf is false"
        elif self._broadcaster is None:
            published = f"{path} only, since {frames} needs tf2_msgs"
        elif self._map.is_placed:
            published = f"{path} and {frames}"
        else:
            published = f"{path}, and {frames} once a place of the map is recognised"
        optional = self._input.depth_info_topic
        return f"Subscribed to {subscribed}, and if it exists {optional}; publishing {published}"
