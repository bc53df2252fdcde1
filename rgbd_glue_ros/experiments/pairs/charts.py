"""Charts of registered pairs: distribution of errors, and adaptation of the threshold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rgbd_glue_ros.evaluation.registration_errors import THRESHOLDS
from rgbd_glue_ros.experiments.pairs.evaluation import INLIER_THRESHOLDS_CM, PairResult
from rgbd_glue_ros.experiments.pairs.metrics import METRICS
from rgbd_glue_ros.experiments.pairs.results import ByGap
from rgbd_glue_ros.experiments.report import charts
from rgbd_glue_ros.experiments.report.axes import Axis, linear, logarithmic
from rgbd_glue_ros.experiments.report.charts import Line
from rgbd_glue_ros.experiments.report.series_colors import CSS as COLORS_CSS
from rgbd_glue_ros.experiments.report.series_colors import look

CSS = (
    COLORS_CSS
    + """
.three { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 17rem), 1fr));
  gap: 1.5rem 2rem; }
"""
)

_ERROR_AXES = {
    "rotation_deg": logarithmic(0.1, 0.5, 1, 5, 10, 45),
    "translation_cm": logarithmic(0.5, 1, 5, 10, 25, 100),
    "chamfer_mm": logarithmic(0.01, 0.1, 1, 5, 10, 100),
}
_PERCENT = Axis(0.0, 100.0, tuple((v, f"{v:g} %") for v in (0.0, 25.0, 50.0, 75.0, 100.0)))
_CURVE_POINTS = 160
_MOST_DOTS = 1500
_AT_5_CM = INLIER_THRESHOLDS_CM.index(5)


def curves(results: Mapping[str, ByGap], names: Mapping[str, str]) -> str:
    """Percent of pairs up to an error: a line for each gap, or for each method in a gap."""
    gaps = sorted({gap for by_gap in results.values() for gap in by_gap})
    if len(results) == 1:
        (own,) = results.values()
        rows = {"": [(f"{gap} frames apart", own[gap]) for gap in gaps]}
    else:
        rows = {
            f"{gap} frames apart": [(names[name], results[name][gap]) for name in results]
            for gap in gaps
        }
    text = (
        "<p>Percent of pairs whose error is at most that; a pair without a transform has none.</p>"
    )
    for title, named in rows.items():
        keys = [_key(name, i) for i, (name, _) in enumerate(named)]
        figures = "".join(_curve(error, [pairs for _, pairs in named]) for error in THRESHOLDS)
        text += f"<h3>{title}</h3>" if title else ""
        text += charts.legend(keys) if len(keys) > 1 else ""
        text += f'<div class="three">{figures}</div>'
    return text


def _curve(error: str, compared: Sequence[Sequence[PairResult]]) -> str:
    axis = _ERROR_AXES[error]
    x = np.geomspace(axis.low, axis.high, _CURVE_POINTS)
    lines = []
    for i, results in enumerate(compared):
        errors = [np.inf if r.errors.failed else getattr(r.errors, error) for r in results]
        below = np.searchsorted(np.sort(errors), x, side="right")
        color, style = look(i)
        lines.append(Line("", color, x, 100 * below / len(errors), style))
    metric = METRICS[error]
    # the first, which is our own, on top
    return charts.plot(f"{metric.title}, {metric.symbol}", lines[::-1], axis, _PERCENT, 6)


def _key(name: str, i: int) -> Line:
    color, style = look(i)
    return Line(name, color, np.empty(0), np.empty(0), style)


def scatter(gap: int, content: Mapping[str, Any], results: Sequence[PairResult]) -> str:
    """Right visual matches by ε² of each filtered pair, and the means of table S3's ranges.

    Args:
        gap: of the pairs.
        content: their figures.
        results: of the pairs; at least one was filtered.
    """
    filtered = [r for r in results if r.filtered]
    some = filtered[:: 1 + len(filtered) // _MOST_DOTS]
    ranges = content["epsilon_squared_ranges"]
    highest = max(ranges[-1]["up_to_m2"], float(np.quantile([r.epsilon_m**2 for r in some], 0.98)))
    x = np.array([r.epsilon_m**2 for r in some])
    y = np.array([100 * r.visual.amounts[_AT_5_CM] / max(1, r.visual.matches) for r in some])
    inside = x <= highest
    cloud = Line("pairs", "var(--estimate)", x[inside], y[inside])
    steps = [
        (edge, row["visual_inlier_ratio"]["5"])
        for row in ranges
        for edge in (row["above_m2"], row["up_to_m2"])
    ]
    mean = Line(
        "mean of a range",
        "var(--geometric)",
        np.array([edge for edge, _ in steps]),
        np.array([np.nan if ratio is None else ratio for _, ratio in steps]),
        "thick",
    )
    return charts.plot(
        f"{gap} frames apart: right visual matches by ε², m²",
        [mean],
        linear(0.0, highest, count=5),
        _PERCENT,
        7,
        [cloud],
    )
