"""Values of a run over time, and its errors, as lines of charts."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.evaluation.trajectory_errors import Evaluation
from rgbd_glue_ros.experiments.replay.run_record import Run
from rgbd_glue_ros.experiments.report import charts
from rgbd_glue_ros.experiments.report.axes import rising, symmetric
from rgbd_glue_ros.experiments.report.charts import Area, Line
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import NANOSECONDS, Float64, Int64

# A line breaks if this many of the usual intervals passed without a frame.
_GAP = 3.0
# Normal and chi (3 degrees of freedom) quantiles, as factors of σ of an axis and of all three.
_OF_AN_AXIS, _OF_A_ROTATION = 1.96, (7.815 / 3) ** 0.5
_ROWS = 4
# A cautious covariance is several times as wide as the errors, and is shown whole.
_WIDEST = 15.0


def since_start(run: Run, stamps_ns: Int64) -> Float64:
    """Seconds since the first frame."""
    return np.asarray((stamps_ns - run.frames[0].stamp_ns) / NANOSECONDS, np.float64)


def with_gaps(run: Run, stamps_ns: Int64, values: Float64) -> tuple[Float64, Float64]:
    """Times and values [N, ...] of a line with breaks where frames were dropped or missing.

    Args:
        run: has the dropped frames.
        stamps_ns: int64 [N], increasing.
        values: float64 [N, ...].

    Returns:
        Seconds since the first frame, and the values, NaN at breaks.
    """
    intervals = np.diff(stamps_ns)
    late = intervals > _GAP * np.median(intervals) if len(intervals) else np.zeros(0, bool)
    between = stamps_ns[:-1][late] + intervals[late] // 2
    breaks = np.concatenate([between, np.array(run.unanswered_ns, np.int64)])
    times = np.concatenate([stamps_ns, breaks])
    unknown = np.full((len(breaks), *values.shape[1:]), np.nan)
    order = np.argsort(times, kind="stable")
    return since_start(run, times[order]), np.concatenate([values, unknown])[order]


def error_charts(run: Run, evaluation: Evaluation, span: tuple[float, float]) -> list[str]:
    """The error of each pose after alignment, and its parts since the start beside σ."""
    x, error = with_gaps(run, evaluation.stamps_ns, 100 * evaluation.errors_m)
    rmse = np.full(len(x), 100 * evaluation.ape.rmse_m)
    lines = [
        Line("rmse", "var(--quiet)", x, rmse, "dashed"),
        Line("of each pose", "var(--estimate)", x, error),
    ]
    drawn = [charts.chart("Position error after alignment, cm", lines, span, _ROWS)]
    position_m, rotation_rad = errors_since_start(evaluation)
    sigmas = sigmas_of(run, evaluation.stamps_ns)
    drawn.append(
        "<p>Since the first pose with ground truth, in the axes of the first camera. The band "
        "contains 95&nbsp;% of the errors if the covariance of each pose is correct: 1.96 σ of an "
        f"axis. It is cut off beyond {_WIDEST:g} times the largest error.</p>"
        if np.isfinite(sigmas).any()
        else "<p>Since the first pose with ground truth, in the axes of the first camera.</p>"
    )
    parts = []
    for i, name in enumerate(("x (right)", "y (down)", "z (forward)")):
        band = 100 * _OF_AN_AXIS * sigmas[:, i]
        both = np.stack([100 * position_m[:, i], -band, band], axis=1)
        parts.append(_part(run, evaluation, f"Error of {name}, cm", both, span))
    band = np.rad2deg(_OF_A_ROTATION * np.sqrt((sigmas[:, 3:] ** 2).sum(axis=1)))
    both = np.stack([np.rad2deg(rotation_rad), np.zeros(len(band)), band], axis=1)
    parts.append(_part(run, evaluation, "Error of rotation, °", both, span))
    return [*drawn, f'<div class="two">{"".join(parts)}</div>']


def _part(
    run: Run, evaluation: Evaluation, title: str, values: Float64, span: tuple[float, float]
) -> str:
    """A chart of an error and of its band, values [N, 3] = error, low, high."""
    x, both = with_gaps(run, evaluation.stamps_ns, values)
    error, low, high = both.T
    furthest = float(np.nanmax(np.abs(error)))
    if np.isfinite(high).any():
        # if a band is far too wide, only the neighbourhood of the error is shown
        furthest = max(furthest, min(float(np.nanmax(high)), _WIDEST * furthest))
    is_signed = bool((values[:, 1] < 0).any() or (values[:, 0] < 0).any())
    y = symmetric(furthest, _ROWS) if is_signed else rising(furthest, _ROWS)
    areas = [Area("95 % by covariance", "var(--estimate)", x, low, high)]
    line = Line("error", "var(--estimate)", x, error)
    return charts.chart(title, [line], span, _ROWS, y, areas if np.isfinite(high).any() else [])


def errors_since_start(evaluation: Evaluation) -> tuple[Float64, Float64]:
    """Errors of poses with the first one aligned with ground truth, in the axes of odom.

    Returns:
        Of positions float64 [N, 3], metres; of rotations the angles float64 [N], radians.
    """
    poses = se3.inverse(evaluation.T_reference_estimate) @ evaluation.estimate
    true = poses[0] @ se3.inverse(evaluation.reference[0]) @ evaluation.reference
    E = se3.inverse(true) @ poses
    angles = np.array([se3.rotation_angle(T) for T in E])
    return poses[:, :3, 3] - true[:, :3, 3], angles


def sigmas_of(run: Run, stamps_ns: Int64) -> Float64:
    """Standard deviations [N, 6] at stamps; NaN where no covariance is known."""
    known = {frame.stamp_ns: frame.sigmas for frame in run.frames if frame.sigmas is not None}
    unknown = np.full(6, np.nan)
    rows = [known.get(stamp_ns, unknown) for stamp_ns in stamps_ns.tolist()]
    return np.array(rows, np.float64).reshape(-1, 6)
