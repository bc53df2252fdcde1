"""Errors of a trajectory against ground truth: APE and RPE as in the TUM RGB-D benchmark.

Both use the poses nearest in time, one-to-one, without interpolation, like the benchmark's tools,
so that figures are comparable with published ones.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.stamp_text import format_stamp
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import procrustes
from rgbd_glue_ros.trajectories.association import MAX_TIME_DIFFERENCE_S, associate
from rgbd_glue_ros.types import NANOSECONDS, Float64, Int64, Trajectory

RPE_DELTA_S = 1.0
"""The time over which relative errors are measured."""

NO_RPE = f"no two poses with ground truth are {RPE_DELTA_S:g} s apart"
"""Why there may be no relative error although there is an absolute one."""

# a pair of poses may differ from RPE_DELTA_S by this fraction, for example if frames are lost
_DELTA_TOLERANCE = 0.1
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

    def __repr__(self) -> str:
        return f"Evaluation({len(self.stamps_ns)} poses, {self.ape}, {self.rpe})"


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
            f"only {len(rows)} poses are within {max_difference_s:g} s of each other, and "
            f"{_MIN_POSES} are needed "
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


def evaluated(estimate: Trajectory, reference: Trajectory | None) -> Evaluation | None:
    """Compares ``estimate`` with ``reference``; None without one, or with too few common poses."""
    if reference is None:
        return None
    try:
        return evaluate(estimate, reference)
    except InputError:
        return None


def error_figures(evaluation: Evaluation) -> dict[str, Any]:
    """Absolute and relative error as in ``metrics.json``."""
    rpe = evaluation.rpe
    return {"ape": asdict(evaluation.ape), "rpe": None if rpe is None else asdict(rpe)}


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
