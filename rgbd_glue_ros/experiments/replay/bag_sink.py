"""A rosbag2 in MCAP of what the node would have published in a replay.

Foxglove, RViz and ``ros2 bag play`` open it. Frames are those of a node without a robot frame.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from rosbags.typesys import Stores, get_typestore

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.writing import NewFolder, not_written
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.evidence_values import evidence_values
from rgbd_glue_ros.live.extrinsics import Extrinsics
from rgbd_glue_ros.live.keyframe_edges import edge_message, graph_start
from rgbd_glue_ros.live.keyframe_graph import moved_edge
from rgbd_glue_ros.live.match_image import match_image
from rgbd_glue_ros.live.odometry_message import odometry_message
from rgbd_glue_ros.messages import fields, making
from rgbd_glue_ros.messages.transform_tree import TF
from rgbd_glue_ros.types import (
    NANOSECONDS,
    Float64,
    OdometryEstimate,
    PoseGraphEdge,
    RgbdFrame,
    TrackingState,
)

ODOM_FRAME, CAMERA_FRAME = "odom", "camera_color_optical_frame"
MATCHES = f"{topics.MATCHES}/compressed"
_TYPES = {
    topics.ODOM: "nav_msgs/msg/Odometry",
    topics.POSE: "geometry_msgs/msg/PoseStamped",
    topics.KEYFRAME_POSE: "geometry_msgs/msg/PoseStamped",
    topics.KEYFRAME_EDGES: "nav_msgs/msg/Odometry",
    topics.PATH: "nav_msgs/msg/Path",
    TF: "tf2_msgs/msg/TFMessage",
    MATCHES: "sensor_msgs/msg/CompressedImage",
    topics.DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
}
# diagnostic_msgs/msg/DiagnosticStatus
_OK, _WARN, _ERROR = 0, 1, 2
_LEVELS = {
    TrackingState.TRACKING: _OK,
    TrackingState.INITIALIZING: _WARN,
    TrackingState.LOST: _ERROR,
}
_JPEG_QUALITY = 80


class BagSink:
    """Writes every estimate as the node would, and finally the path."""

    def __init__(self, folder: Path) -> None:
        """Creates the bag.

        Args:
            folder: of the bag; must not exist.

        Raises:
            InputError: the folder exists or cannot be written.
        """
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._extrinsics = Extrinsics.of_camera("body")
        self._path: list[fields.PoseStamped] = []
        # the stamp of each keyframe by its number, nanoseconds
        self._keyframes: list[int] = []
        self._diagnosed_ns: int | None = None
        self._folder, self._new = folder, NewFolder(folder)
        try:
            self._writer = Writer(
                self._new.path, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP
            )
            self._writer.open()
        except (WriterError, OSError) as error:
            self._new.close()
            raise InputError(folder, f"cannot be written ({error})", "give a new folder") from error
        self._topics = {name: self._topic(name, kind) for name, kind in _TYPES.items()}

    def add(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Takes a frame.

        Raises:
            InputError: its time cannot be stored in a bag.
        """
        making.check_recordable(frame.stamp_ns)
        camera = frame.frame_id or CAMERA_FRAME
        head = making.header(frame.stamp_ns, camera)
        image = making.compressed_color_image(match_image(frame, estimate), head, _JPEG_QUALITY)
        self._write(MATCHES, frame.stamp_ns, image)
        self._diagnose(estimate)
        if estimate.T_odom_camera is not None:
            self._add_pose(estimate.T_odom_camera, frame, estimate, camera)
        for edge in estimate.edges:
            self._add_edge(edge)

    def _add_pose(
        self, T_odom_camera: Float64, frame: RgbdFrame, estimate: OdometryEstimate, camera: str
    ) -> None:
        pose = making.pose_stamped(
            self._extrinsics.pose(T_odom_camera),
            making.header(frame.stamp_ns, ODOM_FRAME),
        )
        self._path.append(pose)
        if not self._keyframes:
            start = graph_start(estimate, self._extrinsics, ODOM_FRAME)
            if start is not None:
                self._write(topics.KEYFRAME_EDGES, frame.stamp_ns, start)
        self._write(topics.POSE, frame.stamp_ns, pose)
        if estimate.is_keyframe:
            self._keyframes.append(frame.stamp_ns)
            self._write(topics.KEYFRAME_POSE, frame.stamp_ns, pose)
        self._write(TF, frame.stamp_ns, self._transform(pose, camera))
        odom = odometry_message(estimate, self._extrinsics, pose, camera)
        if odom is not None:
            self._write(topics.ODOM, frame.stamp_ns, odom)

    def _add_edge(self, edge: PoseGraphEdge) -> None:
        stamp_ns = self._keyframes[edge.child]
        between_children = moved_edge(edge, self._extrinsics.T_camera_child)
        self._write(topics.KEYFRAME_EDGES, stamp_ns, edge_message(between_children, stamp_ns))

    def start_anew(self) -> None:
        """Begins another path, as the node does."""
        self._path.clear()
        self._keyframes.clear()
        self._diagnosed_ns = None

    def close(self) -> None:
        """Writes the path, index and metadata; raises InputError if they cannot be written."""
        try:
            self._finish()
        except OSError as error:
            raise not_written(self._folder, error) from error
        finally:
            self._new.close()

    def _finish(self) -> None:
        if self._path:
            last = self._path[-1].header
            path = self._make("nav_msgs/msg/Path", header=last, poses=self._path)
            self._write(topics.PATH, last.stamp.sec * NANOSECONDS + last.stamp.nanosec, path)
        self._writer.close()

    def _transform(self, pose: fields.PoseStamped, child: str) -> Any:
        at, turn = pose.pose.position, pose.pose.orientation
        transform = self._make(
            "geometry_msgs/msg/TransformStamped",
            header=pose.header,
            child_frame_id=child,
            transform=self._make("geometry_msgs/msg/Transform", translation=at, rotation=turn),
        )
        return self._make("tf2_msgs/msg/TFMessage", transforms=[transform])

    def _diagnose(self, estimate: OdometryEstimate) -> None:
        """State and evidence as the node names them, and durations; once a second."""
        if self._diagnosed_ns is not None:
            since = estimate.stamp_ns - self._diagnosed_ns
            if since < NANOSECONDS:
                return
        self._diagnosed_ns = estimate.stamp_ns
        values = {
            "state": estimate.state.value,
            **evidence_values(estimate),
            **{f"{name}_ms": f"{ms:.2f}" for name, ms in estimate.stages_ms.items()},
        }
        status = self._make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=_LEVELS[estimate.state],
            name="rgbd_odometry: odometry",
            message=estimate.state.value,
            hardware_id="",
            values=[
                self._make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
                for key, value in values.items()
            ],
        )
        head = making.header(estimate.stamp_ns, "")
        array = self._make("diagnostic_msgs/msg/DiagnosticArray", header=head, status=[status])
        self._write(topics.DIAGNOSTICS, estimate.stamp_ns, array)

    def _make(self, kind: str, **values: Any) -> Any:
        return self._store.types[kind](**values)

    def _topic(self, name: str, kind: str) -> Connection:
        return self._writer.add_connection(_absolute(name), kind, typestore=self._store)

    def _write(self, topic: str, stamp_ns: int, message: object) -> None:
        data = self._store.serialize_cdr(message, _TYPES[topic])
        self._writer.write(self._topics[topic], stamp_ns, data)


def _absolute(name: str) -> str:
    return name if name.startswith("/") else f"/{name}"
