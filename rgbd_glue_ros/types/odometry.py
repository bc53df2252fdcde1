"""Results of the odometry after a frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from rgbd_glue_ros.types.arrays import Float64
from rgbd_glue_ros.types.pose_graph import PoseGraphEdge
from rgbd_glue_ros.types.registration import RegistrationResult


class TrackingState(Enum):
    """The odometry's state after a frame."""

    INITIALIZING = "initializing"
    TRACKING = "tracking"
    LOST = "lost"


@dataclass(frozen=True)
class DepthSummary:
    """What a depth image contains.

    Attributes:
        known: share of its pixels that have a depth, 0 to 1.
        in_range: share of its pixels whose depth is between ``camera.depth_min`` and ``depth_max``.
        median_m: median of the known depths, metres; NaN if there are none.
    """

    known: float
    in_range: float
    median_m: float


@dataclass(frozen=True, eq=False)
class OdometryEstimate:
    """Result of the odometry for one frame.

    Attributes:
        stamp_ns: stamp of the frame.
        state: tracking state after the frame.
        T_odom_camera: float64 [4, 4]; None when LOST or INITIALIZING: no pose is invented. Here
            odom is the first optical frame; the node's frame odom is ``fixed`` in ``Extrinsics``.
        covariance: float64 [6, 6] as in nav_msgs/Odometry: of the position, and of the rotation
            about the odom frame's axes through it (x y z rx ry rz; m, rad); None if there is no
            pose.
        twist: float64 [6], linear then angular velocity in the camera's optical frame
            (m/s, rad/s); None if there is no pose, or no earlier one to compare with.
        twist_covariance: float64 [6, 6] of ``twist``; None if that is None.
        is_keyframe: whether the frame is known to be a keyframe.
        keyframe_id: number of the keyframe that the frame was registered against (its own
            number if it became the first); None if there is no pose.
        registration: against that keyframe, or the failed one when LOST; None for a frame at
            which the odometry starts or restarts.
        edges: measured between keyframes since the previous estimate, including this frame's.
        stages_ms: wall time of each of ``types.stages``, milliseconds, with registration's.
        depth: contents of the depth image of a frame without a pose; None if there is a pose.
        covariance_from_keyframe: float64 [6, 6] of the pose given that of the keyframe it was
            registered against; perturbation on the left, in the odom frame. None for a frame at
            which the odometry starts or restarts.
    """

    stamp_ns: int
    state: TrackingState
    T_odom_camera: Float64 | None = None
    covariance: Float64 | None = None
    twist: Float64 | None = None
    twist_covariance: Float64 | None = None
    is_keyframe: bool = False
    keyframe_id: int | None = None
    registration: RegistrationResult | None = None
    edges: tuple[PoseGraphEdge, ...] = ()
    stages_ms: dict[str, float] = field(default_factory=dict)
    depth: DepthSummary | None = None
    covariance_from_keyframe: Float64 | None = None

    @property
    def is_start(self) -> bool:
        """Whether the odometry starts with this frame, or restarts with it at the last pose."""
        return self.is_keyframe and self.registration is None
