"""A run as a Rerun recording (rerun.io): a file, or sent to a viewer."""

from __future__ import annotations

import logging
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.evaluation.trajectory_errors import evaluated
from rgbd_glue_ros.files.user_paths import expanded
from rgbd_glue_ros.files.writing import not_written
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import project
from rgbd_glue_ros.geometry.reduction import reduced
from rgbd_glue_ros.geometry.views import rectified
from rgbd_glue_ros.live.extrinsics import T_BODY_OPTICAL
from rgbd_glue_ros.live.match_image import CREDIBLE, REJECTED, VISUAL, drawn, rejected
from rgbd_glue_ros.slam.cloud import cloud_of
from rgbd_glue_ros.trajectories.path import trajectory_of
from rgbd_glue_ros.types import (
    NANOSECONDS,
    CameraIntrinsics,
    Correspondences,
    EdgeOrigin,
    Float64,
    OdometryEstimate,
    PoseGraph,
    RegistrationResult,
    RgbdFrame,
    TrackingState,
    Trajectory,
)
from rgbd_glue_ros.viz import layout

logger = logging.getLogger(__name__)

ADDRESS = "rerun+http"
"""Prefix of the address of a viewer."""

# where a viewer listens, and how long it may take to respond
_PORT, _PATIENCE_S = 9876, 5.0
_APPLICATION = "rgbd_glue_ros"
# Sufficient for viewing; a second of 640x480 at 30 Hz is 4 MB of a file.
_COLOR_WIDTH, _DEPTH_WIDTH, _JPEG_QUALITY = 640, 320, 80
# Rerun has the corner of an image at the origin, and pixel centres between whole numbers.
_HALF_PIXEL = 0.5
_MILLIMETRES = 1000.0
_FARTHEST_M = 65.0
_CLOUD_VOXEL_M = 0.02
# of the lines of matches; negative, in points of the screen
_THIN = -0.75
_EYE_M, _KEYFRAME_EYE_M = 0.12, 0.05
# Chi with three degrees of freedom: the ellipsoid holds 95 % of the positions.
_HOLDS_95 = 7.815**0.5
_ESTIMATE_RGB, _TRUTH_RGB, _CORRECTED_RGB = (60, 140, 255), (120, 120, 120), (40, 180, 90)
_LOOP_RGB, _KEYFRAME_RGB, _COVARIANCE_RGB = (230, 60, 160), (255, 160, 40), (60, 140, 255)
_LEVELS = {TrackingState.TRACKING: "INFO", TrackingState.LOST: "ERROR"}


class RerunRecording(Closing):
    """Logs frames and their results.

    The scene's z axis is up, its x axis where the camera first looks; below it everything is in
    the camera's axes.
    """

    def __init__(self, target: str, truth: Trajectory | None = None) -> None:
        """Opens the file, or connects to the viewer.

        Args:
            target: file to write, by convention ``.rrd``, or address of a running viewer, such as
                ``rerun+http://127.0.0.1:9876/proxy``.
            truth: T_world_camera, finally drawn beside the trajectory.

        Raises:
            InputError: the file cannot be written, or no viewer responds at the address.
            MissingExtraError: Rerun is not installed.
        """
        self._rerun = load_rerun()
        self._target = target
        self._truth = truth
        self._first_ns: int | None = None
        self._state: TrackingState | None = None
        self._last_position: Float64 | None = None
        # only for the truth, since a node may run for days
        self._poses: dict[int, Float64] = {}
        self._keyframes = 0
        self._T_fixed_odom = np.full((4, 4), np.nan)
        self._stream = self._rerun.RecordingStream(_APPLICATION)
        blueprint = layout.blueprint(self._rerun)
        if target.startswith(ADDRESS):
            _check_viewer(target)
            self._stream.connect_grpc(target, default_blueprint=blueprint)
        else:
            self._stream.save(_writable(expanded(target, "rerun")), default_blueprint=blueprint)
        self._describe()
        self.place(T_BODY_OPTICAL)

    def close(self) -> None:
        """Draws the ground truth, and completes the output.

        It does not wait for a viewer that has ended.
        """
        self._draw_truth()
        try:
            self._stream.flush(timeout_sec=_PATIENCE_S)
        except RuntimeError as error:
            logger.warning("%s: is incomplete (%s)", self._target, error)
        self._stream.disconnect()

    def place(self, T_fixed_odom: Float64) -> None:
        """Sets the pose of the odom frame with the camera's axes, float64 [4, 4]."""
        if not np.array_equal(T_fixed_odom, self._T_fixed_odom):
            self._T_fixed_odom = T_fixed_odom
            self._log(layout.ODOM, self._transform(T_fixed_odom), static=True)

    def start_anew(self) -> None:
        """Ends the line of the trajectory: the next pose is in another odom frame."""
        self._last_position = None
        self._poses.clear()

    def add(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Adds a frame and its result."""
        frame = rectified(frame)
        self._set_time(frame.stamp_ns)
        self._draw_images(frame, estimate)
        self._plot(estimate)
        if estimate.state is not self._state:
            self._state = estimate.state
            level = _LEVELS.get(self._state, "WARN")
            self._log(layout.STATE, self._rerun.TextLog(self._state.value, level=level))
        if estimate.T_odom_camera is None:
            return
        self._draw_pose(estimate.T_odom_camera, estimate.covariance)
        self._extend_trajectory(frame.stamp_ns, estimate.T_odom_camera)
        if estimate.is_keyframe:
            self._add_keyframe(frame, estimate.T_odom_camera)

    def correct(self, trajectory: Trajectory, graph: PoseGraph, first: int = 0) -> None:
        """Draws the result of loop closure, at the end of the recording.

        Args:
            trajectory: T_map_camera of all frames.
            graph: of the keyframes at their optimum, and of the loops.
            first: how many keyframes were added before those of ``graph``.
        """
        self._poses = dict(zip(trajectory.stamps_ns.tolist(), trajectory.poses, strict=True))
        for number, T in enumerate(graph.keyframes.poses, first):
            self._log(_keyframe(number), self._transform(T))
        places = graph.keyframes.poses[:, :3, 3]
        loops = (edge for edge in graph.edges if edge.origin is EdgeOrigin.LOOP)
        ends = [places[[loop.parent, loop.child]] for loop in loops]
        self._draw_lines(layout.LOOPS, ends, _LOOP_RGB)
        self._draw_lines(layout.CORRECTED, [trajectory.poses[:, :3, 3]], _CORRECTED_RGB)

    def _describe(self) -> None:
        """Logs what does not change: axes, colours and names of lines."""
        rr = self._rerun
        self._log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for path, rgb, name in (
            (layout.EPSILON, _ESTIMATE_RGB, "epsilon"),
            (f"{layout.COUNTS}/visual", VISUAL, "visual inliers"),
            (f"{layout.COUNTS}/credible", CREDIBLE, "credible"),
            (f"{layout.COUNTS}/rejected", REJECTED, "rejected"),
            (layout.LATENCY, _ESTIMATE_RGB, "ms"),
        ):
            self._log(path, rr.SeriesLines(colors=[rgb], names=[name]), static=True)

    def _set_time(self, stamp_ns: int) -> None:
        if self._first_ns is None:
            self._first_ns = stamp_ns
        elapsed = (stamp_ns - self._first_ns) / NANOSECONDS
        self._stream.set_time(layout.ELAPSED, duration=elapsed)
        self._stream.set_time(layout.STAMP, timestamp=np.datetime64(stamp_ns, "ns"))

    def _draw_images(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        rr = self._rerun
        shown, small = reduced(frame, _COLOR_WIDTH), reduced(frame, _DEPTH_WIDTH)
        self._log(layout.CAMERA, self._pinhole(shown.intrinsics, _EYE_M))
        self._log(layout.COLOR, rr.Image(shown.color).compress(jpeg_quality=_JPEG_QUALITY))
        self._log(layout.DEPTH_CAMERA, self._pinhole(small.intrinsics, _EYE_M))
        known = np.where((small.depth > 0) & (small.depth < _FARTHEST_M), small.depth, 0.0)
        units = np.rint(_MILLIMETRES * known).astype(np.uint16)
        self._log(layout.DEPTH, rr.DepthImage(units, meter=_MILLIMETRES))
        result = estimate.registration
        if result is not None:
            for name, matches, rgb in _kinds(result):
                self._draw_matches(f"{layout.MATCHES}/{name}", matches, shown.intrinsics, rgb)

    def _draw_matches(
        self,
        path: str,
        matches: Correspondences,
        camera: CameraIntrinsics,
        rgb: tuple[int, int, int],
    ) -> None:
        """Lines from the positions of points in the keyframe to those in this frame."""
        some = drawn(matches)
        ends = [project(points, camera) for points in (some.target, some.source)]
        lines = np.stack(ends, axis=1) + _HALF_PIXEL
        self._log(path, self._rerun.LineStrips2D(lines, colors=[rgb], radii=[_THIN]))

    def _plot(self, estimate: OdometryEstimate) -> None:
        scalars = {layout.LATENCY: sum(estimate.stages_ms.values())}
        result = estimate.registration
        if result is not None:
            for name, matches, _ in _kinds(result):
                scalars[f"{layout.COUNTS}/{name}"] = len(matches)
            if np.isfinite(result.epsilon_m):
                scalars[layout.EPSILON] = 100 * result.epsilon_m
        for path, value in scalars.items():
            self._log(path, self._rerun.Scalars([value]))

    def _draw_pose(self, T_odom_camera: Float64, covariance: Float64 | None) -> None:
        for path in (layout.CAMERA, layout.DEPTH_CAMERA):
            self._log(path, self._transform(T_odom_camera))
        if covariance is None:
            return
        variances, axes = np.linalg.eigh(covariance[:3, :3])
        axes[:, 2] *= np.sign(np.linalg.det(axes))  # a rotation, not a reflection
        ellipsoid = self._rerun.Ellipsoids3D(
            centers=[T_odom_camera[:3, 3]],
            half_sizes=[_HOLDS_95 * np.sqrt(np.maximum(variances, 0.0))],
            quaternions=[self._rerun.Quaternion(xyzw=se3.quaternion(axes))],
            colors=[_COVARIANCE_RGB],
        )
        self._log(layout.COVARIANCE, ellipsoid)

    def _extend_trajectory(self, stamp_ns: int, T_odom_camera: Float64) -> None:
        position = T_odom_camera[:3, 3].copy()
        if self._last_position is not None:
            piece = np.stack([self._last_position, position])
            self._draw_lines(layout.TRAJECTORY, [piece], _ESTIMATE_RGB)
        self._last_position = position
        if self._truth is not None:
            self._poses[stamp_ns] = T_odom_camera

    def _add_keyframe(self, frame: RgbdFrame, T_odom_camera: Float64) -> None:
        path = _keyframe(self._keyframes)
        self._keyframes += 1
        self._log(path, self._transform(T_odom_camera))
        eye = self._pinhole(frame.intrinsics, _KEYFRAME_EYE_M, color=_KEYFRAME_RGB)
        self._log(f"{path}/eye", eye)
        cloud = cloud_of(frame, _CLOUD_VOXEL_M)
        points = self._rerun.Points3D(cloud.points, colors=cloud.colors, radii=[_CLOUD_VOXEL_M / 2])
        self._log(f"{path}/cloud", points)

    def _draw_truth(self) -> None:
        """Draws the ground truth, aligned with the trajectory as for the absolute error."""
        aligned = evaluated(trajectory_of(self._poses.items()), self._truth)
        if aligned is None:
            return  # as reported in the figures of the run
        T_odom_truth = se3.inverse(aligned.T_reference_estimate)
        way = se3.transform(T_odom_truth, aligned.reference[:, :3, 3])
        self._draw_lines(layout.TRUTH, [way], _TRUTH_RGB, static=True)

    def _draw_lines(
        self,
        path: str,
        lines: Sequence[Float64],
        rgb: tuple[int, int, int],
        *,
        static: bool = False,
    ) -> None:
        drawn = self._rerun.LineStrips3D(lines, colors=[rgb])
        self._log(path, drawn, static=static)

    def _transform(self, T: Float64) -> Any:
        return self._rerun.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3])

    def _pinhole(self, camera: CameraIntrinsics, eye_m: float, **style: Any) -> Any:
        return self._rerun.Pinhole(
            focal_length=[camera.fx, camera.fy],
            principal_point=[camera.cx + _HALF_PIXEL, camera.cy + _HALF_PIXEL],
            resolution=[camera.width, camera.height],
            image_plane_distance=eye_m,
            **style,
        )

    def _log(self, path: str, archetype: Any, *, static: bool = False) -> None:
        self._stream.log(path, archetype, static=static)


def load_rerun() -> Any:
    """Imports and returns Rerun.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import rerun  # noqa: PLC0415
        import rerun.blueprint  # noqa: PLC0415
    except ImportError as error:
        raise MissingExtraError("rerun-sdk", "viz", "a recording for the Rerun viewer") from error
    return rerun


def _kinds(
    result: RegistrationResult,
) -> tuple[tuple[str, Correspondences, tuple[int, int, int]], ...]:
    """Matches by outcome, in three colours."""
    return (
        ("visual", result.visual_inliers, VISUAL),
        ("credible", result.credible, CREDIBLE),
        ("rejected", rejected(result), REJECTED),
    )


def _keyframe(number: int) -> str:
    return f"{layout.KEYFRAMES}/{number}"


def _check_viewer(address: str) -> None:
    """Checks whether a viewer listens: Rerun itself would try for ever.

    Raises:
        InputError: no viewer listens.
    """
    try:
        parts = urlsplit(address)
        place = parts.hostname or "127.0.0.1", parts.port or _PORT
        socket.create_connection(place, timeout=_PATIENCE_S).close()
    except (OSError, ValueError) as error:
        raise InputError(
            address, f"no viewer responds there ({error})", "start 'rerun' first, or give a file"
        ) from error


def _writable(path: Path) -> Path:
    """The path, after checking that it can be written.

    Raises:
        InputError: it is not.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("wb").close()
    except OSError as error:
        raise not_written(path, error) from error
    return path
