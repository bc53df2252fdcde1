"""The mapping node: closes loops on top of the odometry node, and publishes map -> odom.

It subscribes to keyframes and their edges from the odometry node, and to images from the camera.
``odom`` stays smooth; loop closures correct only ``map`` -> ``odom``.
"""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMessage

from rgbd_glue_ros import parameters as cfg
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.user_paths import file_to_write
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.end_signals import EndSignals
from rgbd_glue_ros.live.extrinsics import Extrinsics
from rgbd_glue_ros.live.keyframe_edges import edge_from_message
from rgbd_glue_ros.live.keyframe_graph import moved_edge
from rgbd_glue_ros.live.map_summary import DroppedMap, describe_dropped, describe_end
from rgbd_glue_ros.live.odometry_faults import explain_late_start
from rgbd_glue_ros.live.recent_images import RecentImages
from rgbd_glue_ros.live.worker import QueueWorker
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.messages.synchronizer import Match
from rgbd_glue_ros.node.base_node import CLOSE_S, BaseNode
from rgbd_glue_ros.node.extrinsics import NodeExtrinsics
from rgbd_glue_ros.node.map_loading import MapLoading, given_map_file
from rgbd_glue_ros.node.map_path import MapPath
from rgbd_glue_ros.node.mapping_diagnostics import MappingDiagnostics
from rgbd_glue_ros.node.odometry_input import OdometryInput
from rgbd_glue_ros.node.parameters import NO_CAMERA, declare_parameters, follow_changes
from rgbd_glue_ros.node.rgbd_input import RgbdInput
from rgbd_glue_ros.node.runtime import GiveUp, run_node
from rgbd_glue_ros.node.saving import create_save_service
from rgbd_glue_ros.node.tf import Broadcaster, listen
from rgbd_glue_ros.parameters.inputs import MAP_BY_RECEIPT
from rgbd_glue_ros.slam.keyframe_stream import KeyframeStream, NewKeyframe
from rgbd_glue_ros.slam.live_map import LiveMap, PublishedKeyframe
from rgbd_glue_ros.slam.map_saving import MapSaving
from rgbd_glue_ros.slam.unrecognised import Unrecognised
from rgbd_glue_ros.types import PoseGraphEdge, RgbdFrame

NODE_NAME = "rgbd_mapping"
# Keyframes that wait for their images, and those that wait for the worker, at most.
KEYFRAMES_WAITING = 100
# All others are fixed: keyframes of a map are comparable only if made with the same parameters.
CHANGEABLE = ("save_map_file",)


@dataclass(frozen=True)
class _Keyframe:
    """A keyframe and its messages, decoded on the worker's thread; None if they are missing."""

    keyframe: NewKeyframe
    match: Match[Any] | None


@dataclass(frozen=True)
class _NewGraph:
    """The odometry has restarted: what follows is not related to what came before."""


class MappingNode(BaseNode):
    """Publishes ``map`` -> ``odom`` and ``map/path``."""

    def __init__(self, give_up: GiveUp, camera: Mapping[str, cfg.Value] = NO_CAMERA) -> None:
        """Declares the parameters, and loads the map; subscribes as soon as that is done.

        Args:
            give_up: called from another thread if the map cannot be loaded, or the libraries of the
                extra slam are not installed.
            camera: as for ``declare_parameters``.

        Raises:
            InputError: a parameter has an invalid value.
        """
        super().__init__(NODE_NAME)
        self._config, config = declare_parameters(self, camera, CHANGEABLE)
        self._config.check_for_mapping()
        transforms = listen(self, self._config)
        self._extrinsics = NodeExtrinsics(self, self._config, transforms)
        self._map_lock = threading.Lock()
        self._saving = MapSaving()
        self._unrecognised = Unrecognised()
        self._stream = KeyframeStream()
        self._matches: RecentImages[Match[Any]] = RecentImages(lambda: self._stream.awaited_ns)
        self._input = RgbdInput(
            self, self._config, transforms, self._receive, with_two_clocks=MAP_BY_RECEIPT
        )
        self._broadcaster = None if transforms is None else Broadcaster(self)
        self._worker: QueueWorker[_NewGraph | _Keyframe | PoseGraphEdge] = QueueWorker(
            self._process, KEYFRAMES_WAITING
        )
        self._waiting: deque[_NewGraph | NewKeyframe | PoseGraphEdge] = deque()
        follow_changes(self, self._config, config, self._take_parameters, CHANGEABLE)
        given = given_map_file(self._config)
        self._loading = MapLoading(self, given, config, self._begin, give_up)

    def _begin(self, live_map: LiveMap) -> None:
        """Subscribes and publishes."""
        self._map = live_map
        self._path = MapPath(self, self._config.map_frame_id)
        self._odometry = OdometryInput(
            self,
            self._take_pose,
            self._take_keyframe,
            self._take_edge,
            lambda: self._input.has_received,
        )
        self._diagnostics = MappingDiagnostics(
            self, self._map, self._input.watch, lambda: len(self._waiting) + len(self._worker)
        )
        self._input.subscribe()
        create_save_service(self, topics.SAVE_MAP_SERVICE, "map", self._save_map)
        self.get_logger().info(self._description())

    def _finish(self) -> bool:
        """Finishes the current keyframe; a map is not loaded to the end."""
        has_ended = self._worker.close(CLOSE_S) and self._loading.is_over
        if has_ended:
            self._input.close()
            if self._loading.is_passed_on:
                self._say_what_is_left()
        return has_ended

    def _say_what_is_left(self) -> None:
        changed, saved = not self._config.localize_only, self._saving.state
        service = self._save_service
        said = describe_end(len(self._map.poses), self._map.loops, saved, service, changed)
        self.get_logger().info(said)

    @property
    def _save_service(self) -> str:
        return str(self.resolve_service_name(topics.SAVE_MAP_SERVICE))

    def _take_parameters(self, config: cfg.NodeConfig, _: cfg.Config) -> None:
        self._config = config

    def _save_map(self) -> str:
        if self._config.localize_only:
            cause = "is true, so the map does not change and there is nothing to save"
            remedy = f"it is in {self._config.map_file}; to add to it, start without localize_only"
            raise InputError("localize_only", cause, remedy)
        path = file_to_write(self._config.save_map_file, "save_map_file")
        with self._map_lock:
            # of this map, even if another begins while the file is written
            saved, saving = self._map.saved(), self._saving
        if not len(saved):
            raise InputError(path, "there is no keyframe yet", "move the camera")
        return saving.save(path, saved)

    # Input

    def _receive(self, match: Match[Any], _arrived_ns: int) -> None:
        self._matches.add(match.stamp_ns, match)
        self._submit([])

    def _take_pose(self, pose: PoseStamped) -> None:
        self._matches.track(stamp_ns(pose.header.stamp))
        self._broadcast(pose)

    def _take_keyframe(self, message: PoseStamped) -> None:
        at_ns = stamp_ns(message.header.stamp)
        T = pose_from_message(message, topics.KEYFRAME_POSE)
        self._submit(self._stream.add_pose(at_ns, T))

    def _take_edge(self, message: OdometryMessage) -> None:
        keyframes, late = self._stream.add_edge(
            stamp_ns(message.header.stamp), edge_from_message(message)
        )
        self._submit([*keyframes, *([] if late is None else [late])])

    def _submit(self, items: Sequence[NewKeyframe | PoseGraphEdge]) -> None:
        """Submits keyframes and edges to the worker, in order, once their images have arrived."""
        for item in items:
            if isinstance(item, NewKeyframe) and item.is_anew:
                # images of the previous graph may never come, for example when time went back
                self._waiting.clear()
                self._waiting.append(_NewGraph())
                self._say_what_it_missed(item.number)
            self._waiting.append(item)
        while self._waiting and (
            len(self._waiting) > KEYFRAMES_WAITING or not self._is_awaited(self._waiting[0])
        ):
            oldest = self._waiting.popleft()
            if isinstance(oldest, NewKeyframe):
                self._submit_keyframe(oldest)
            else:
                self._worker.submit(oldest)

    def _say_what_it_missed(self, first: int) -> None:
        """Warns if the first keyframe that came of a graph is a later one."""
        if first > 0:
            self.warn_once("Map", explain_late_start(first, self._odometry.nodes))

    def _is_awaited(self, item: _NewGraph | NewKeyframe | PoseGraphEdge) -> bool:
        """Whether the images of a keyframe may still arrive."""
        if not isinstance(item, NewKeyframe) or self._matches.at(item.stamp_ns) is not None:
            return False
        return self._matches.may_come(item.stamp_ns)

    def _submit_keyframe(self, keyframe: NewKeyframe) -> None:
        match = self._matches.at(keyframe.stamp_ns)
        if match is None:
            why = (
                "images have no stamp, and each process receives them at a different time: make "
                "the driver stamp them"
                if self._input.is_by_receipt
                else "it was lost on the way, or this node's topics are not those of the odometry"
            )
            self.warn_once(
                f"keyframe {keyframe.number}",
                f"no image has its stamp, so it is skipped; {why}",
            )
        # even without images, its edges connect earlier keyframes with later ones
        self._worker.submit(_Keyframe(keyframe, match))

    # Work, on the worker's thread

    def _process(self, item: _NewGraph | _Keyframe | PoseGraphEdge) -> None:
        try:
            if isinstance(item, _Keyframe):
                self._add(item)
            elif isinstance(item, PoseGraphEdge):
                self._add_edge(item)
            else:
                self._begin_anew()
        except InputError as fault:
            self.report(fault)
        except Exception as error:
            self.report_failure("A keyframe could not be mapped", error)

    def _begin_anew(self) -> None:
        """Starts another map, and says what becomes of the one before."""
        # the odometry may have restarted with another camera
        self._extrinsics.forget()
        with self._map_lock:
            said = describe_dropped(self._dropped(), self._save_service)
            self._map.clear()
            self._unrecognised.recognised()
            self._saving = MapSaving()
        if said:
            self.get_logger().warning(said)

    def _dropped(self) -> DroppedMap:
        """What there is before another map begins."""
        given, count = self._map.given, self._map.session_keyframes
        if given is None:
            return DroppedMap(count, self._saving.state)
        is_placed = self._map.is_placed
        return DroppedMap(count, self._saving.state, given.name, len(given), is_placed)

    def _frame(self, item: _Keyframe) -> RgbdFrame | None:
        """The images of a keyframe; None if they are missing or unusable."""
        if item.match is None:
            return None
        try:
            return self._input.frame(item.match)
        except InputError as fault:
            self.report(fault)
            return None

    def _add_edge(self, edge: PoseGraphEdge) -> None:
        extrinsics = self._extrinsics.known
        if extrinsics is not None:
            T_child_camera = se3.inverse(extrinsics.T_camera_child)
            with self._map_lock:
                self._map.add_edge(moved_edge(edge, T_child_camera))

    def _add(self, item: _Keyframe) -> None:
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
            self.get_logger().info(f"Keyframe {keyframe.number} shows a known place")
        self._say_if_unrecognised()
        if self._map.loops > before:
            self.get_logger().info(
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
            self.get_logger().warning(said)

    def _broadcast(self, pose: PoseStamped) -> None:
        """Publishes map -> odom at the stamp of a pose, once the transform is known."""
        T_map_odom = self._map.T_map_odom
        if self._broadcaster is not None and T_map_odom is not None:
            at_ns = stamp_ns(pose.header.stamp)
            self._broadcaster.publish(
                self._config.map_frame_id, self._config.odom_frame_id, T_map_odom, at_ns
            )

    def _description(self) -> str:
        """What the node subscribes to and publishes."""
        subscribed = ", ".join([*self._input.topics, *self._odometry.topics])
        path = self._path.topic
        frames = f"{self._config.map_frame_id} -> {self._config.odom_frame_id}"
        if self._broadcaster is None:
            published = f"{path} only, since {frames} needs tf2_msgs"
        elif self._map.is_placed:
            published = f"{path} and {frames}"
        else:
            published = f"{path}, and {frames} once a place of the map is recognised"
        optional = self._input.depth_info_topic
        return f"Subscribed to {subscribed}, and if it exists {optional}; publishing {published}"


def main(
    args: list[str] | None = None,
    end_signals: EndSignals | None = None,
    camera: Mapping[str, cfg.Value] = NO_CAMERA,
) -> int:
    """Runs the node until a signal ends it; arguments and exit code as for the odometry node."""
    return run_node(NODE_NAME, lambda give_up: MappingNode(give_up, camera), args, end_signals)


if __name__ == "__main__":
    sys.exit(main())
