"""Errors of a trajectory against ground truth: APE and RPE as in the TUM RGB-D benchmark.

Both use the poses nearest in time, one-to-one, without interpolation, like the benchmark's tools,
so that figures are comparable with published ones.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.stamp_text import format_stamp
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import mahalanobis_squared, procrustes
from rgbd_glue_ros.trajectories.association import MAX_TIME_DIFFERENCE_S, associate
from rgbd_glue_ros.types import NANOSECONDS, Float64, Int64, OdometryEstimate, Trajectory

RPE_DELTA_S = 1.0
"""The time over which relative errors are measured."""

NO_RPE = f"no two poses with ground truth are {RPE_DELTA_S:g} s apart"
"""Why there may be no relative error although there is an absolute one."""

# a pair of poses may differ from RPE_DELTA_S by this fraction, for example if frames are lost
_DELTA_TOLERANCE = 0.1
# true motion between poses further apart than this cannot be interpolated
_MAX_TRUTH_GAP_NS = NANOSECONDS // 10
# fewer positions than this can be aligned with any others
_MIN_POSES = 3
# Added to a stamp, longer ones exceed 64 bits
_LONGEST_DIFFERENCE_S = 1e9


@dataclass(frozen=True)
class Ape:
    """Absolute pose error: distances of positions after SE(3) alignment (no scale), metres."""

    rmse_m: float
    mean_m: float
    median_m: float
    max_m: float


@dataclass(frozen=True)
class Rpe:
    """Relative pose error over ``delta_s`` seconds: drift in metres and degrees."""

    delta_s: float
    trans_rmse_m: float
    rot_rmse_deg: float


@dataclass(frozen=True)
class Evaluation:
    """A trajectory compared with ground truth.

    Attributes:
        ape: absolute error.
        rpe: relative error; None for a trajectory shorter than ``RPE_DELTA_S``.
        stamps_ns: int64 [N], of the estimated poses with ground truth, increasing.
        estimate: float64 [N, 4, 4], estimated poses aligned with the truth.
        reference: float64 [N, 4, 4], true poses.
        errors_m: float64 [N], distances of their positions.
        T_reference_estimate: float64 [4, 4], the alignment.
    """

    ape: Ape
    rpe: Rpe | None
    stamps_ns: Int64
    estimate: Float64
    reference: Float64
    errors_m: Float64
    T_reference_estimate: Float64


def evaluate(
    estimate: Trajectory,
    reference: Trajectory,
    max_difference_s: float = MAX_TIME_DIFFERENCE_S,
) -> Evaluation:
    """Compares ``estimate`` with ``reference``.

    Raises:
        InputError: too few poses are within ``max_difference_s`` of each other, or it is no time.
    """
    if not 0 <= max_difference_s <= _LONGEST_DIFFERENCE_S:
        raise InputError(
            "evaluate.max_difference_s",
            f"is {max_difference_s:g}",
            f"give seconds, such as {MAX_TIME_DIFFERENCE_S:g}",
        )
    rows, true_rows = associate(estimate.stamps_ns, reference.stamps_ns, max_difference_s)
    if len(rows) < _MIN_POSES:
        raise InputError(
            "estimate and reference",
            f"only {len(rows)} poses are within {max_difference_s:g} s of each other "
            f"(estimate {_span(estimate)}, reference {_span(reference)})",
            "give trajectories of the same recording",
        )
    stamps, true = estimate.stamps_ns[rows], reference.poses[true_rows]
    T = align(estimate.poses[rows], true)
    aligned = T @ estimate.poses[rows]
    errors = np.linalg.norm(aligned[:, :3, 3] - true[:, :3, 3], axis=1)
    return Evaluation(
        Ape(_rmse(errors), float(errors.mean()), float(np.median(errors)), float(errors.max())),
        relative_error(stamps, aligned, true),
        stamps,
        aligned,
        true,
        errors,
        T,
    )


def align(estimate: Float64, reference: Float64) -> Float64:
    """T_reference_estimate [4, 4] that best aligns the positions of poses [N, 4, 4] with others.

    In the sense of least squares, without scale (Umeyama 1991).
    """
    source, target = (np.ascontiguousarray(poses[:, :3, 3]) for poses in (estimate, reference))
    return np.asarray(procrustes(source, target, np.ones(len(source))), np.float64)


def relative_error(stamps_ns: Int64, estimate: Float64, reference: Float64) -> Rpe | None:
    """RPE over every pair of poses ``RPE_DELTA_S`` apart.

    Args:
        stamps_ns: int64 [N], increasing.
        estimate: float64 [N, 4, 4].
        reference: float64 [N, 4, 4], at the same times.

    Returns:
        The error, None if no two poses are that far apart.
    """
    first, second = _pairs(stamps_ns)
    if not len(first):
        return None
    moved = se3.inverse(estimate[first]) @ estimate[second]
    truly = se3.inverse(reference[first]) @ reference[second]
    E = se3.inverse(truly) @ moved
    angles = np.rad2deg(Rotation.from_matrix(E[:, :3, :3]).magnitude())
    return Rpe(RPE_DELTA_S, _rmse(np.linalg.norm(E[:, :3, 3], axis=1)), _rmse(angles))


def normalised_errors(estimates: Iterable[OdometryEstimate], reference: Trajectory) -> Float64:
    """NEES of the transforms from every frame to its keyframe: consistency of the covariances.

    xi' P^-1 xi with xi = log(T_estimated T_true^-1), T from the frame to its keyframe (Bar-Shalom,
    Li and Kirubarajan 2001). For a consistent covariance its mean is 6. If an estimate does not
    state its uncertainty relative to its keyframe, this is the excess of the frame's covariance
    over the keyframe's.

    Args:
        estimates: in order of time.
        reference: true poses; between two of them the truth is interpolated, since a stamp missed
            by milliseconds would count as an error of the estimate.

    Returns:
        float64 [N], for every frame with a pose, a keyframe other than itself, and ground truth for
        both.
    """
    posed = [e for e in estimates if e.T_odom_camera is not None and e.covariance is not None]
    truth = interpolated(reference, np.array([e.stamp_ns for e in posed], np.int64))
    keyframes: list[tuple[OdometryEstimate, Float64]] = []
    errors = []
    for estimate, true in zip(posed, truth, strict=True):
        # a frame that restarts the odometry has its own number
        if estimate.keyframe_id < len(keyframes):
            errors.append(_normalised_error(estimate, true, *keyframes[estimate.keyframe_id]))
        if estimate.is_keyframe:
            keyframes.append((estimate, true))
    normalised = np.array(errors, np.float64)
    return normalised[np.isfinite(normalised)]


def _normalised_error(
    frame: OdometryEstimate, true: Float64, keyframe: OdometryEstimate, true_keyframe: Float64
) -> float:
    """NEES of the transform between two estimates; NaN if ground truth is not known."""
    T, T_keyframe = frame.T_odom_camera, keyframe.T_odom_camera
    if T is None or T_keyframe is None or frame.covariance is None or keyframe.covariance is None:
        return float("nan")
    expected = T_keyframe @ se3.inverse(true_keyframe) @ true
    if not np.isfinite(expected).all():
        return float("nan")
    error = se3.log(T @ se3.inverse(expected))
    if frame.covariance_from_keyframe is not None:
        return mahalanobis_squared(error, frame.covariance_from_keyframe)
    covariance = se3.perturbation_covariance(T, frame.covariance)
    covariance = covariance - se3.perturbation_covariance(T_keyframe, keyframe.covariance)
    return mahalanobis_squared(error, covariance)


def interpolated(reference: Trajectory, stamps_ns: Int64) -> Float64:
    """Poses [N, 4, 4] at any stamps; NaN outside, and if neighbours are too far apart in time.

    Positions are interpolated linearly, rotations along the shortest path. At the stamp of a pose,
    the result is that pose.
    """
    poses = np.full((len(stamps_ns), 4, 4), np.nan)
    stamps, rows = np.unique(reference.stamps_ns, return_index=True)
    if not len(stamps):
        return poses
    known = reference.poses[rows]
    nearest = np.searchsorted(stamps, stamps_ns).clip(0, len(stamps) - 1)
    exact = stamps[nearest] == stamps_ns
    poses[exact] = known[nearest[exact]]
    if len(stamps) < 2:
        return poses
    after = np.searchsorted(stamps, stamps_ns).clip(1, len(stamps) - 1)
    gap = stamps[after] - stamps[after - 1]
    inside = (stamps_ns >= stamps[0]) & (stamps_ns <= stamps[-1]) & (gap <= _MAX_TRUTH_GAP_NS)
    inside &= ~exact
    if not inside.any():
        return poses  # older versions of scipy refuse an empty interpolation
    # floats can represent microseconds since the first stamp, but not since 1970
    times, wanted = (np.asarray(s - stamps[0], np.float64) for s in (stamps, stamps_ns[inside]))
    poses[inside] = np.eye(4)
    poses[inside, :3, :3] = Slerp(times, Rotation.from_matrix(known[:, :3, :3]))(wanted).as_matrix()
    poses[inside, :3, 3] = np.stack([np.interp(wanted, times, x) for x in known[:, :3, 3].T], 1)
    return poses


def path_length(poses: Float64) -> float:
    """Length of the path through poses [N, 4, 4], metres."""
    return float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())


def _pairs(stamps_ns: Int64) -> tuple[Int64, Int64]:
    """For each pose the one nearest to RPE_DELTA_S later, if there is one."""
    delta = round(RPE_DELTA_S * NANOSECONDS)
    wanted = stamps_ns + delta
    after = np.searchsorted(stamps_ns, wanted).clip(1, max(1, len(stamps_ns) - 1))
    before = after - 1
    nearer = wanted - stamps_ns[before] <= stamps_ns[after] - wanted
    second = np.where(nearer, before, after)
    first = np.arange(len(stamps_ns))
    is_near = np.abs(stamps_ns[second] - wanted) <= round(_DELTA_TOLERANCE * delta)
    # the last pose is nearest to every time after it
    is_within = wanted - stamps_ns[-1] <= round(MAX_TIME_DIFFERENCE_S * NANOSECONDS)
    kept = is_near & is_within
    return first[kept], second[kept]


def _rmse(errors: Float64) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def _span(trajectory: Trajectory) -> str:
    if not len(trajectory):
        return "is empty"
    first, last = trajectory.stamps_ns.min(), trajectory.stamps_ns.max()
    return f"from {format_stamp(first)} to {format_stamp(last)} s"
