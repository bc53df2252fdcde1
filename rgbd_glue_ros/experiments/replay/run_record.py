"""The results of a run over a recording, frame by frame, and its figures (``metrics.json``)."""

from __future__ import annotations

import resource
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from statistics import median
from typing import Any

import numpy as np

from rgbd_glue_ros.evaluation.graph_errors import edge_errors
from rgbd_glue_ros.evaluation.trajectory_errors import Evaluation, error_figures
from rgbd_glue_ros.experiments.report.machine import package_version
from rgbd_glue_ros.geometry.se3 import largest_sigmas
from rgbd_glue_ros.live.unseen_motion import sigma_from_keyframe
from rgbd_glue_ros.odometry.pose_covariance import UNKNOWN
from rgbd_glue_ros.parameters import Config, InputConfig
from rgbd_glue_ros.trajectories.path import path_length, trajectory_of
from rgbd_glue_ros.types import (
    NANOSECONDS,
    Float64,
    ImuCalibration,
    OdometryEstimate,
    PoseGraph,
    PoseGraphEdge,
    TrackingState,
    Trajectory,
)


@dataclass(frozen=True)
class Provenance:
    """How a run came about.

    Attributes:
        inputs: how its recording was opened.
        command: the command line; "" if it was started by a program.
        warnings: what was warned of as the recording was opened.
    """

    inputs: InputConfig = field(default_factory=InputConfig)
    command: str = ""
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class FrameRecord:
    """The record of one frame.

    Attributes:
        stamp_ns: stamp of the frame.
        state: tracking state after it.
        T_odom_camera: float64 [4, 4], None without a pose.
        latency_ms: wall time until the pose was known.
        is_keyframe: whether it became a keyframe.
        edges: measured between keyframes since the previous frame.
        visual_inliers: |C_vis^in|, None if nothing was registered.
        credible: |C_geo^in|, None if nothing was registered.
        stages_ms: wall time of each stage.
        sigmas: float64 [6], standard deviations of the pose (x y z rx ry rz; m, rad) in the odom
            frame; None if no covariance is known.
        position_m: standard deviation of its position along the most uncertain direction, metres;
            None if no covariance is known.
        from_keyframe_m: standard deviation of its position given that of its keyframe, metres,
            along the most uncertain direction; None if that is not known.
        is_start: whether the odometry started with it, or restarted at the last pose.
    """

    stamp_ns: int
    state: TrackingState
    T_odom_camera: Float64 | None
    latency_ms: float
    is_keyframe: bool = False
    edges: tuple[PoseGraphEdge, ...] = ()
    visual_inliers: int | None = None
    credible: int | None = None
    stages_ms: dict[str, float] = field(default_factory=dict)
    sigmas: Float64 | None = None
    position_m: float | None = None
    from_keyframe_m: float | None = None
    is_start: bool = False

    @staticmethod
    def of(estimate: OdometryEstimate, latency_ms: float) -> FrameRecord:
        """The record of an estimate: numbers, without correspondences."""
        result, covariance = estimate.registration, estimate.covariance
        return FrameRecord(
            stamp_ns=estimate.stamp_ns,
            state=estimate.state,
            T_odom_camera=estimate.T_odom_camera,
            latency_ms=latency_ms,
            is_keyframe=estimate.is_keyframe,
            edges=estimate.edges,
            visual_inliers=len(result.visual_inliers) if result else None,
            credible=len(result.credible) if result else None,
            stages_ms=estimate.stages_ms,
            sigmas=None if covariance is None else np.sqrt(np.diag(covariance)),
            position_m=None if covariance is None else largest_sigmas(covariance)[0],
            from_keyframe_m=sigma_from_keyframe(estimate),
            is_start=estimate.is_start,
        )


@dataclass
class Run:
    """A run in progress.

    Attributes:
        sequence: name of the recording.
        config: of the odometry.
        ground_truth: T_world_camera, None if not known.
        frames: every frame so far.
        wall_s: time since the start.
        unanswered_ns: stamps of frames that were played to a node and came back without a pose.
        thumbnails: small JPEGs of some frames, by stamp.
        map_jpeg: picture of the map; empty without one.
        up: which way is up in the frame of the trajectory, a unit vector [3]; None without an IMU.
        imu: what was finally learnt about the IMU; None if there was none.
        command: the command line of the run; "" if it was started by a program.
        restarts: rows of ``frames`` before which time went back. The odometry restarted there: what
            follows is in another odom frame and pose graph.
        duplicates: frames skipped because their stamp repeats an earlier one.
        unpaired: images without a partner, which are in no frame, by kind; empty if the recording
            does not count them.
        uncorrected: the poses before loops were closed; None if none were looked for.
        warnings: what a reader of the report has to know: what was warned of, and how the run ended
            if it did not come to its end.
    """

    sequence: str
    config: Config
    ground_truth: Trajectory | None = None
    frames: list[FrameRecord] = field(default_factory=list)
    wall_s: float = 0.0
    unanswered_ns: tuple[int, ...] = ()
    thumbnails: dict[int, bytes] = field(default_factory=dict)
    map_jpeg: bytes = b""
    up: Float64 | None = None
    imu: ImuCalibration | None = None
    command: str = ""
    restarts: tuple[int, ...] = ()
    duplicates: int = 0
    unpaired: Mapping[str, int] = field(default_factory=dict)
    uncorrected: Trajectory | None = None
    warnings: list[str] = field(default_factory=list)

    def add(self, estimate: OdometryEstimate, latency_ms: float) -> None:
        """Records ``estimate``."""
        self.frames.append(FrameRecord.of(estimate, latency_ms))

    def start_anew(self) -> None:
        """Begins another part, as time went back."""
        self.restarts = (*self.restarts, len(self.frames))

    @property
    def parts(self) -> list[Run]:
        """The run cut where time went back; itself where it did not."""
        cuts = [0, *self.restarts, len(self.frames)]
        return [
            replace(self, frames=self.frames[start:stop], restarts=())
            for start, stop in pairwise(cuts)
        ]

    @property
    def blind_restarts(self) -> list[FrameRecord]:
        """The frames with which the odometry restarted at the last pose, not recognising any."""
        starts = ([frame for frame in part.frames if frame.is_start] for part in self.parts)
        return [frame for first_and_later in starts for frame in first_and_later[1:]]

    @property
    def unseen_motion(self) -> list[FrameRecord]:
        """The frames whose images did not show how the camera had moved, as at a bare wall."""
        return [frame for frame in self.frames if (frame.from_keyframe_m or 0.0) >= UNKNOWN]

    @property
    def longest_row(self) -> int:
        """Which of the parts has most poses, the first of these."""
        poses = [len(part.trajectory) for part in self.parts]
        return poses.index(max(poses))

    @property
    def longest_part(self) -> Run:
        """That with most poses: errors, pose graph and map can be of one part alone."""
        return self.parts[self.longest_row]

    @property
    def trajectory(self) -> Trajectory:
        """The poses of all frames that have one."""
        return _trajectory(self.frames)

    @property
    def pose_graph(self) -> PoseGraph:
        """The keyframes of a part, and the measurements between them."""
        keyframes = [frame for frame in self.frames if frame.is_keyframe]
        edges = tuple(edge for frame in self.frames for edge in frame.edges)
        return PoseGraph(_trajectory(keyframes), edges)


def _trajectory(frames: list[FrameRecord]) -> Trajectory:
    return trajectory_of((frame.stamp_ns, frame.T_odom_camera) for frame in frames)


def metrics(run: Run, evaluation: Evaluation | None) -> dict[str, Any]:
    """The content of ``metrics.json``.

    Args:
        run: with at least one frame.
        evaluation: of the trajectory of its longest part; None without ground truth.
    """
    states = [frame.state for frame in run.frames]
    latencies = [frame.latency_ms for frame in run.frames]
    p50, p95, p99 = np.percentile(latencies, [50, 95, 99])
    parts, graph = run.parts, run.longest_part.pose_graph
    content: dict[str, Any] = {
        "sequence": run.sequence,
        "version": package_version(),
        "played": len(run.frames) + len(run.unanswered_ns),
        "frames": len(run.frames),
        "tracked": states.count(TrackingState.TRACKING),
        "lost": states.count(TrackingState.LOST),
        "keyframes": sum(frame.is_keyframe for frame in run.frames),
        "restarts": len(run.restarts),
        "blind_restarts": len(run.blind_restarts),
        "unseen_motion": len(run.unseen_motion),
        "duplicates": run.duplicates,
        "unpaired": dict(run.unpaired) or None,
        "longest_gap_s": max(map(_longest_gap_s, parts)),
        "fps": len(run.frames) / run.wall_s,
        "latency_ms": {
            "p50": float(p50),
            "p95": float(p95),
            "p99": float(p99),
            "max": max(latencies),
        },
        "stages_ms": stage_medians(frame.stages_ms for frame in run.frames),
        # ru_maxrss is in kilobytes on Linux
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "path_m": sum(path_length(part.trajectory.poses) for part in parts),
    }
    if run.up is not None:
        content["up"] = run.up.tolist()
    if run.imu is not None:
        content["imu"] = run.imu.values()
    if evaluation is not None:
        content |= error_figures(evaluation)
    if run.ground_truth is not None and graph.edges:
        errors = edge_errors(graph, run.ground_truth)
        content["edges"] = {origin.name.lower(): asdict(e) for origin, e in errors.items()}
    return content


def _longest_gap_s(part: Run) -> float:
    """The longest time between two frames; 0 where there are no two."""
    stamps_ns = np.array([frame.stamp_ns for frame in part.frames], np.int64)
    return float(np.diff(stamps_ns).max(initial=0)) / NANOSECONDS


def stage_medians(frames: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """The median time of every stage over the frames that had it, milliseconds."""
    times: dict[str, list[float]] = {}
    for stages in frames:
        for stage, milliseconds in stages.items():
            times.setdefault(stage, []).append(milliseconds)
    return {stage: median(values) for stage, values in times.items()}
