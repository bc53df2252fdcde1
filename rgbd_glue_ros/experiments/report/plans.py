"""Paths in a plane, in several views at the same scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rgbd_glue_ros.experiments.report.charts import SIDE, Line, caption, path
from rgbd_glue_ros.experiments.report.escaping import escape
from rgbd_glue_ros.types import Float64, Int64

CSS = """
.plan .plot { margin: 0 0 2.8rem; height: auto; aspect-ratio: var(--ratio); }
.scale { position: absolute; right: 0; top: calc(100% + .5rem); color: var(--quiet);
  font-size: .72rem; border: solid var(--quiet); border-width: 0 1px 1px; padding: 0 0 .25rem;
  text-align: center; line-height: 1; }
.plan .here { display: none; stroke: var(--text); }
.plan .here.on { display: inline; }
"""

# Fractions of a view's width: its minimum height, and the room for strokes at the edge.
_LEAST_HEIGHT = 0.3
_MARGIN = 0.08


def plans(views: Sequence[tuple[str, Sequence[Line], Float64]]) -> str:
    """Views of paths side by side, at the same scale: axes are equal, within and among views.

    The first point of the last line of a view is marked green, its last one red.

    Args:
        views: of each the title, the lines, x to the right and y up, and the times float64 [N] of
            the last line's points, for a pointer at a moment.
    """
    extents = [_extent(lines) for _, lines, _ in views]
    longest = max(float((high - low).max()) for low, high in extents) or 1.0
    margin = _MARGIN * longest
    width = max(float((high - low)[0]) for low, high in extents) + margin
    width = max(width, _LEAST_HEIGHT * longest)
    drawn = [
        _plan(title, lines, times, (low + high) / 2, width, float((high - low)[1]) + margin)
        for (title, lines, times), (low, high) in zip(views, extents, strict=True)
    ]
    return f'<div class="two">{"".join(drawn)}</div>'


def _extent(lines: Sequence[Line]) -> tuple[Float64, Float64]:
    xy = np.concatenate([np.stack([line.x, line.y]) for line in lines], axis=1)
    return np.nanmin(xy, axis=1), np.nanmax(xy, axis=1)


def _plan(
    title: str, lines: Sequence[Line], times: Float64, middle: Float64, width: float, height: float
) -> str:
    """One view, ``width`` metres wide and as high as it needs."""
    height = max(height, _LEAST_HEIGHT * width)
    scale = SIDE / width
    drawn = []
    for line in lines:
        x = (line.x - middle[0] + width / 2) * scale
        y = (height / 2 - (line.y - middle[1])) * scale
        kept = _spaced(x, y)
        drawn.append(path(line, x[kept], y[kept]))
        ends = (x[0], y[0], "var(--good)"), (x[-1], y[-1], "var(--bad)")
    moments = " ".join(
        f"{t:.2f},{px:.0f},{py:.0f}"
        for t, px, py in zip(times[kept], x[kept], y[kept], strict=True)
        if np.isfinite(px)
    )
    drawn += [
        f'<path class="dot" style="--c:{color}" d="M{px:.1f} {py:.1f}h0"/>'
        for px, py, color in ends
    ]
    bar = round_length(0.4 * width)
    length = f"{bar:g} m" if bar >= 1 else f"{100 * bar:g} cm"
    return (
        f'<figure class="chart plan">{caption(title, lines)}'
        f'<div class="plot" style="--ratio:{SIDE}/{SIDE * height / width:.0f}">'
        f'<svg viewBox="0 0 {SIDE} {SIDE * height / width:.0f}" role="img" '
        f'aria-label="{escape(title)}">{"".join(drawn)}'
        f'<path class="dot here" data-moments="{moments}" d=""/></svg>'
        f'<span class="scale" style="width:{100 * bar / width:.2f}%">{length}</span>'
        "</div></figure>"
    )


def round_length(longest: float) -> float:
    """The largest of 1, 2, 5, 10 ... (of any power of ten) that is not longer than ``longest``."""
    power = 10.0 ** np.floor(np.log10(longest) + 1e-9)
    step = max(step for step in (1.0, 2.0, 5.0) if step * power <= longest * (1 + 1e-9))
    return float(f"{step * power:.12g}")


def _spaced(x: Float64, y: Float64) -> Int64:
    """Rows of points with a visible distance, and of those that break a line."""
    kept = [0]
    for i in range(1, len(x)):
        # a difference from an unknown value is not small
        if not abs(x[i] - x[kept[-1]]) + abs(y[i] - y[kept[-1]]) <= 1.0:
            kept.append(i)
    return np.array([*kept, len(x) - 1], np.int64)
