"""The data that flows through the package, frozen: frames in, correspondences, poses out.

Conventions: ``T_a_b`` maps points in frame b to frame a. Camera frames are optical frames
(REP-103: x right, y down, z forward). Metres, radians, seconds; stamps are integer nanoseconds.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.input_checks import (
    check_distortion,
    check_frame,
    check_frame_id,
    check_intrinsics,
    check_stamps,
)

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
UInt8 = NDArray[np.uint8]
Int64 = NDArray[np.int64]

NANOSECONDS = 1_000_000_000


class LensModel(Enum):
    """How a lens moves points away from where a pinhole has them; coefficients as in OpenCV.

    The values are what ROS calls the models.
    """

    BROWN_CONRADY = "plumb_bob"
    """k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]]]] (Brown 1966; rational in k4 to k6)"""
    INVERSE_BROWN_CONRADY = "inverse_brown_conrady"
    """The same, but from the distorted point back to the pinhole's, as in librealsense"""
    KANNALA_BRANDT = "equidistant"
    """k1 k2 k3 k4, a polynomial in the angle to the axis (Kannala and Brandt 2006)"""

    @property
    def counts(self) -> tuple[int, ...]:
        """How many coefficients there can be, zeros behind the last one included."""
        return (4,) if self is LensModel.KANNALA_BRANDT else (4, 5, 8, 12, 14)


@dataclass(frozen=True)
class CameraIntrinsics:
    """A pinhole camera behind a lens; pixel centres are at integer coordinates.

    Attributes:
        width: image width, pixels; 0 with ``height`` where a calibration does not tell the size.
        height: image height, pixels.
        fx: focal length along x, pixels.
        fy: focal length along y, pixels.
        cx: principal point x, pixels.
        cy: principal point y, pixels.
        distortion: coefficients of ``lens``; empty for a rectified image.
        lens: what they are the coefficients of.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    lens: LensModel = LensModel.BROWN_CONRADY

    def __post_init__(self) -> None:
        """Checks the numbers.

        Raises:
            InputError: a size, a focal length or a centre is none, or the coefficients are no lens.
        """
        check_intrinsics(self.width, self.height, self.fx, self.fy, self.cx, self.cy)
        check_distortion(self.distortion, self.lens.counts)

    @property
    def matrix(self) -> Float64:
        """The camera matrix K, shape [3, 3]."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    @property
    def focal_and_centre(self) -> Float64:
        """fx, fy, cx, cy as an array [4], which compiled code takes."""
        return np.array([self.fx, self.fy, self.cx, self.cy], np.float64)

    def scaled(self, width: int, height: int) -> CameraIntrinsics:
        """The same camera with its image resized to ``width`` x ``height`` pixels."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            # pixel centres are at integers, so the image's edge is at -0.5
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
        )


@dataclass(frozen=True)
class RgbdFrame:
    """One colour image with the depth image registered to it.

    Attributes:
        stamp_ns: time of the colour image, nanoseconds.
        color: uint8, [H, W, 3] RGB or [H, W] grey.
        depth: float32 [H, W], metres along the optical axis, NaN where unknown.
        intrinsics: of both images, whose size they take where they have none.
        frame_id: the optical frame of the camera, from the message header; "" if unknown.
        depth_delay_ns: stamp of the depth image less ``stamp_ns``, nanoseconds.
    """

    stamp_ns: int
    color: UInt8
    depth: Float32
    intrinsics: CameraIntrinsics
    frame_id: str = ""
    depth_delay_ns: int = 0

    def __post_init__(self) -> None:
        """Checks the images.

        Raises:
            InputError: they are of another type, shape or unit.
        """
        camera = self.intrinsics
        check_frame(self.color, self.depth, camera.width, camera.height)
        check_stamps(self.stamp_ns, self.depth_delay_ns)
        check_frame_id(self.frame_id)
        if camera.width == 0:
            height, width = self.depth.shape
            sized = replace(camera, width=width, height=height)
            object.__setattr__(self, "intrinsics", sized)


@dataclass(frozen=True)
class View:
    """A frame prepared for registration: no distortion, no depth out of range.

    Attributes:
        grey: uint8 [H, W].
        depth: float32 [H, W], metres, NaN where unknown.
        intrinsics: of both.
        twist: float64 [6], velocity of the camera (linear, angular; m/s, rad/s; optical frame)
            when the image was taken; zero if it is not known.
        readout_time: seconds from the first row to the last of a rolling shutter; 0 for a global
            shutter.
        depth_delay: how much later than colour depth was taken, seconds.
    """

    grey: UInt8
    depth: Float32
    intrinsics: CameraIntrinsics
    twist: Float64 = field(default_factory=lambda: np.zeros(6))
    readout_time: float = 0.0
    depth_delay: float = 0.0


@dataclass(frozen=True)
class Correspondences:
    """Matched 3D points, one row a match.

    Attributes:
        source: float64 [N, 3], points p in the source camera's optical frame, metres.
        target: float64 [N, 3], points q in the target camera's optical frame, metres.
        weights: float64 [N], w of equation 10, not negative.
    """

    source: Float64
    target: Float64
    weights: Float64

    def __len__(self) -> int:
        return len(self.weights)

    def select(self, rows: NDArray[np.bool_] | Int64) -> Correspondences:
        """The matches at ``rows`` (a mask [N] or indices)."""
        return Correspondences(self.source[rows], self.target[rows], self.weights[rows])

    def __add__(self, other: Correspondences) -> Correspondences:
        """The union of two disjoint sets (equation 9)."""
        return Correspondences(
            np.concatenate([self.source, other.source]),
            np.concatenate([self.target, other.target]),
            np.concatenate([self.weights, other.weights]),
        )

    def moved_target(self, T: Float64) -> Correspondences:
        """The matches with their targets in the frame that T [4, 4] maps to."""
        return replace(self, target=self.target @ T[:3, :3].T + T[:3, 3])

    @staticmethod
    def empty() -> Correspondences:
        """No matches."""
        return Correspondences(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))


class RegistrationStatus(Enum):
    """Whether a registration gave a transform, and if not, why."""

    OK = "ok"
    TOO_FEW_CORRESPONDENCES = "too few correspondences"
    DEGENERATE = "the correspondences do not fix all six degrees of freedom"
    INCONSISTENT = "the transform disagrees with the depth images or the motion"


@dataclass(frozen=True)
class RegistrationResult:
    """What registering a source frame against a target frame gave.

    Attributes:
        T_target_source: float64 [4, 4], or None unless ``status`` is OK.
        status: OK, or why there is no transform.
        visual: C_vis, lifted to 3D.
        visual_inliers: C_vis^in, equation 4.
        geometric: C_geo, before the filter.
        credible: C_geo^in, equation 8; C_geo when the filter was skipped.
        filtered: whether the consistency filter was applied (equation 8) or skipped.
        sigma_m: sigma-hat of equation 5, metres; NaN when there was none.
        epsilon_m: epsilon of equation 7, metres; NaN when the filter was skipped.
        covariance: float64 [6, 6] of T_target_source (x y z rx ry rz, perturbation on the left,
            in the target frame; m, rad), or None unless ``status`` is OK.
        stages_ms: wall time of each stage, milliseconds.
    """

    T_target_source: Float64 | None
    status: RegistrationStatus
    visual: Correspondences
    visual_inliers: Correspondences
    geometric: Correspondences
    credible: Correspondences
    filtered: bool = False
    sigma_m: float = float("nan")
    epsilon_m: float = float("nan")
    covariance: Float64 | None = None
    stages_ms: dict[str, float] = field(default_factory=dict)

    def accepted(self, T_target_source: Float64, covariance: Float64) -> RegistrationResult:
        """This result with a transform."""
        return replace(
            self,
            T_target_source=T_target_source,
            covariance=covariance,
            status=RegistrationStatus.OK,
        )

    def refused(self, status: RegistrationStatus) -> RegistrationResult:
        """This result without a transform, and why."""
        return replace(self, T_target_source=None, covariance=None, status=status)

    def with_stage(self, name: str, milliseconds: float) -> RegistrationResult:
        """This result with the wall time of one more stage."""
        return replace(self, stages_ms={**self.stages_ms, name: milliseconds})


class TrackingState(Enum):
    """The odometry's state after a frame."""

    INITIALIZING = "initializing"
    TRACKING = "tracking"
    LOST = "lost"


class EdgeOrigin(Enum):
    """What measured the transform between two keyframes."""

    TRACKING = "the child was tracked from the parent"
    ASSUMED = "the camera was lost in between, and hardly moved as far as the covariance says"
    REVISIT = "the child saw again what the parent, an anchor of long ago, had seen"
    LOOP = "recognised by appearance and verified by registration"


@dataclass(frozen=True)
class PoseGraphEdge:
    """A measured transform between two keyframes.

    Attributes:
        parent: number of the keyframe whose frame the transform maps to.
        child: number of the keyframe whose frame it maps from.
        T_parent_child: float64 [4, 4].
        covariance: float64 [6, 6] of T_parent_child (x y z rx ry rz; m, rad; perturbation on the
            left, in the parent's frame), positive definite.
        origin: what measured it.
    """

    parent: int
    child: int
    T_parent_child: Float64
    covariance: Float64
    origin: EdgeOrigin = EdgeOrigin.TRACKING


@dataclass(frozen=True)
class DepthSummary:
    """What a depth image holds.

    Attributes:
        known: share of its pixels that have a depth, 0 to 1.
        in_range: share of its pixels whose depth is between ``camera.depth_min`` and ``depth_max``.
        median_m: of the known ones, metres; NaN if there is none.
    """

    known: float
    in_range: float
    median_m: float


@dataclass(frozen=True)
class OdometryEstimate:
    """What the odometry knows after one frame.

    Attributes:
        stamp_ns: stamp of the frame.
        state: tracking state after the frame.
        T_odom_camera: float64 [4, 4]; None when LOST or INITIALIZING: no pose is made up.
        covariance: float64 [6, 6] as in nav_msgs/Odometry: of the position, and of the rotation
            about the odom frame's axes through it (x y z rx ry rz; m, rad); None when there is no
            pose.
        twist: float64 [6], linear then angular velocity in the camera's optical frame
            (m/s, rad/s); None when there is no pose, or no earlier one to differ from.
        twist_covariance: float64 [6, 6] of ``twist``; None when that is.
        is_keyframe: whether the frame is known to be a keyframe.
        keyframe_id: number of the keyframe that the frame was registered against (its own
            number if it became the first); -1 when there is none.
        registration: against that keyframe, or the one that failed when LOST; None for a frame
            that starts anew.
        edges: measured between keyframes since the estimate before, this frame's included.
        stages_ms: wall time of each stage, milliseconds, registration included.
        depth: of a frame without a pose, what its depth image holds; None when there is a pose.
    """

    stamp_ns: int
    state: TrackingState
    T_odom_camera: Float64 | None = None
    covariance: Float64 | None = None
    twist: Float64 | None = None
    twist_covariance: Float64 | None = None
    is_keyframe: bool = False
    keyframe_id: int = -1
    registration: RegistrationResult | None = None
    edges: tuple[PoseGraphEdge, ...] = ()
    stages_ms: dict[str, float] = field(default_factory=dict)
    depth: DepthSummary | None = None


@dataclass(frozen=True)
class Trajectory:
    """Poses over time.

    Attributes:
        stamps_ns: int64 [N], not necessarily increasing.
        poses: float64 [N, 4, 4], T_world_body at each stamp.
    """

    stamps_ns: Int64
    poses: Float64

    def __len__(self) -> int:
        return len(self.stamps_ns)
