"""What a run over a recording gave, frame by frame, and its figures (``metrics.json``)."""

from __future__ import annotations

import resource
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from statistics import median
from typing import Any

import numpy as np

from rgbd_glue_ros.evaluation.trajectory import PoseGraph, PoseGraphEdge
from rgbd_glue_ros.evaluation.trajectory_errors import Evaluation, path_length
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.types import Float64, OdometryEstimate, TrackingState, Trajectory


@dataclass(frozen=True)
class FrameRecord:
    """What is kept of one frame.

    Attributes:
        stamp_ns: stamp of the frame.
        state: tracking state after it.
        T_odom_camera: float64 [4, 4], None without a pose.
        latency_ms: wall time until the pose was known.
        is_keyframe: whether it became a keyframe.
        parent: of a keyframe, the number of the keyframe that it was registered against; None if
            there is none.
        covariance: float64 [6, 6] of that registration; None where ``parent`` is.
        visual_inliers: |C_vis^in|, None where nothing was registered.
        credible: |C_geo^in|, None where nothing was registered.
        stages_ms: wall time of each stage.
    """

    stamp_ns: int
    state: TrackingState
    T_odom_camera: Float64 | None
    latency_ms: float
    is_keyframe: bool = False
    parent: int | None = None
    covariance: Float64 | None = None
    visual_inliers: int | None = None
    credible: int | None = None
    stages_ms: dict[str, float] = field(default_factory=dict)

    @staticmethod
    def of(estimate: OdometryEstimate, latency_ms: float) -> FrameRecord:
        """What is kept of an estimate: numbers, and no correspondences."""
        result = estimate.registration
        is_linked = estimate.is_keyframe and result is not None and result.covariance is not None
        return FrameRecord(
            stamp_ns=estimate.stamp_ns,
            state=estimate.state,
            T_odom_camera=estimate.T_odom_camera,
            latency_ms=latency_ms,
            is_keyframe=estimate.is_keyframe,
            parent=estimate.keyframe_id if is_linked else None,
            covariance=result.covariance if result and is_linked else None,
            visual_inliers=len(result.visual_inliers) if result else None,
            credible=len(result.credible) if result else None,
            stages_ms=estimate.stages_ms,
        )


@dataclass
class Run:
    """A run in the making.

    Attributes:
        sequence: name of the recording.
        config: of the odometry.
        ground_truth: T_world_camera, None if not known.
        frames: every frame so far.
        wall_s: time since the start.
    """

    sequence: str
    config: Config
    ground_truth: Trajectory | None = None
    frames: list[FrameRecord] = field(default_factory=list)
    wall_s: float = 0.0

    def add(self, estimate: OdometryEstimate, latency_ms: float) -> None:
        """Keeps what ``estimate`` says of its frame."""
        self.frames.append(FrameRecord.of(estimate, latency_ms))

    @property
    def trajectory(self) -> Trajectory:
        """The poses of all frames that have one."""
        return _trajectory(self.frames)

    @property
    def pose_graph(self) -> PoseGraph:
        """The keyframes, and the registrations between them."""
        keyframes = [frame for frame in self.frames if frame.is_keyframe]
        vertices = _trajectory(keyframes)
        # by the poses and not by the registration, which knows nothing of what refined them
        edges = tuple(
            PoseGraphEdge(
                frame.parent,
                row,
                se3.inverse(vertices.poses[frame.parent]) @ vertices.poses[row],
                frame.covariance,
            )
            for row, frame in enumerate(keyframes)
            if frame.parent is not None and frame.covariance is not None
        )
        return PoseGraph(vertices, edges)


def _trajectory(frames: list[FrameRecord]) -> Trajectory:
    poses = [(f.stamp_ns, f.T_odom_camera) for f in frames if f.T_odom_camera is not None]
    return Trajectory(
        np.array([stamp for stamp, _ in poses], np.int64),
        np.array([T for _, T in poses], np.float64).reshape(-1, 4, 4),
    )


def metrics(run: Run, evaluation: Evaluation | None) -> dict[str, Any]:
    """The content of ``metrics.json``.

    Args:
        run: with one frame at least.
        evaluation: of its trajectory; None without ground truth.
    """
    states = [frame.state for frame in run.frames]
    latencies = [frame.latency_ms for frame in run.frames]
    p50, p95, p99 = np.percentile(latencies, [50, 95, 99])
    content: dict[str, Any] = {
        "sequence": run.sequence,
        "frames": len(run.frames),
        "tracked": states.count(TrackingState.TRACKING),
        "lost": states.count(TrackingState.LOST),
        "keyframes": len(run.pose_graph.keyframes),
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
        "path_m": path_length(run.trajectory.poses),
    }
    if evaluation is not None:
        content["ape"] = asdict(evaluation.ape)
        content["rpe"] = asdict(evaluation.rpe) if evaluation.rpe else None
    return content


def stage_medians(frames: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """The median time of every stage over the frames that had it, milliseconds."""
    times: dict[str, list[float]] = {}
    for stages in frames:
        for stage, milliseconds in stages.items():
            times.setdefault(stage, []).append(milliseconds)
    return {stage: median(values) for stage, values in times.items()}
