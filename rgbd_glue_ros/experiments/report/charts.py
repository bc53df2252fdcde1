"""Charts as self-contained HTML: shapes in SVG, with text outside it so that it keeps its size.

Shapes are drawn in a square of ``SIDE`` units that the page stretches to any width.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.experiments.report.axes import Axis, linear, rising
from rgbd_glue_ros.experiments.report.escaping import escape
from rgbd_glue_ros.types import Float64

SIDE = 1000
_COLUMNS = 800
_ROW_REM = 1.7

CSS = """
.chart { margin: 0; }
.chart figcaption { display: flex; flex-wrap: wrap; gap: .2rem 1.1rem; align-items: baseline;
  margin-bottom: .5rem; }
.chart figcaption b { font-weight: 600; margin-right: auto; }
@media (max-width: 34rem) { .chart figcaption b { flex-basis: 100%; } }
.key { color: var(--quiet); font-size: .8rem; white-space: nowrap; }
.key i { display: inline-block; width: 1.1rem; height: 0; margin-right: .4rem;
  vertical-align: .22rem; border-top: 2.5px solid var(--c); }
.key.dashed i { border-top-style: dashed; border-top-width: 2px; }
.legend { display: flex; flex-wrap: wrap; gap: .2rem 1.2rem; margin: 0 0 1rem; }
.plot { position: relative; height: var(--h); margin: 0 0 0 2.9rem; }
.time { position: relative; padding-bottom: 2.9rem; }
.plot svg { position: absolute; inset: 0; width: 100%; height: 100%; overflow: visible; }
.plot path, .plot line { fill: none; vector-effect: non-scaling-stroke; stroke: var(--c);
  stroke-width: 1.6; stroke-linejoin: round; stroke-linecap: round; }
.plot .grid { stroke: var(--line); stroke-width: 1; }
.plot .dashed { stroke-dasharray: 5 4; stroke-width: 1.3; }
.plot .thick { stroke-width: 3.2; }
.plot .dot { stroke-width: 9; }
.plot .area { fill: var(--c); stroke: none; opacity: .16; }
.key.area i { border-top-width: .6rem; opacity: .3; vertical-align: -.02rem; }
.plot .lone { stroke-width: 4; }
.plot .dots { stroke-width: 6; opacity: .5; }
.tick { position: absolute; color: var(--quiet); font-size: .72rem; line-height: 1;
  font-variant-numeric: tabular-nums; white-space: nowrap; }
.tick.y { right: calc(100% + .5rem); transform: translateY(50%); }
.tick.x { top: calc(100% + .45rem); transform: translateX(-50%); }
.bars { display: grid; grid-template-columns: max-content 1fr max-content; gap: .45rem .8rem;
  align-items: center; font-size: .88rem; }
.bars div { height: .85rem; border-radius: 3px; background: var(--c); min-width: 2px; }
.bars span:nth-child(3n) { text-align: right; font-variant-numeric: tabular-nums; }
"""


@dataclass(frozen=True)
class Line:
    """A line in a chart.

    Attributes:
        label: what it shows; a line without one is not in the legend.
        color: a CSS colour.
        x: float64 [N].
        y: float64 [N]; NaN breaks the line.
        style: further CSS classes: ``dashed``, ``thick``.
    """

    label: str
    color: str
    x: Float64
    y: Float64
    style: str = ""


@dataclass(frozen=True)
class Area:
    """The area between two lines over time.

    Attributes:
        label: what it shows.
        color: a CSS colour.
        x: float64 [N].
        low: float64 [N].
        high: float64 [N], NaN where nothing is known, as ``low``.
    """

    label: str
    color: str
    x: Float64
    low: Float64
    high: Float64


def chart(
    title: str,
    lines: Sequence[Line],
    x_range: tuple[float, float],
    rows: int,
    y: Axis | None = None,
    areas: Sequence[Area] = (),
) -> str:
    """Lines over a common x axis in seconds; a pointer shows the same moment in all such charts.

    Args:
        title: with the unit of y.
        lines: to draw, the last on top.
        x_range: ends of the x axis.
        rows: approximate number of grid lines; determines the height.
        y: the axis upward; None for one from zero that covers all lines.
        areas: drawn below the lines.
    """
    if y is None:
        highest = max((float(np.nanmax(line.y)) for line in lines if _known(line)), default=1.0)
        y = rising(highest, rows)
    return plot(title, lines, linear(*x_range, " s"), y, rows, areas=areas, is_timed=True)


def plot(
    title: str,
    lines: Sequence[Line],
    x: Axis,
    y: Axis,
    rows: int,
    dots: Sequence[Line] = (),
    areas: Sequence[Area] = (),
    *,
    is_timed: bool = False,
) -> str:
    """Lines and dots in a plane.

    Args:
        title: of the figure.
        lines: to draw, the last on top.
        x: the axis to the right.
        y: the axis upward, with a grid line at each tick.
        rows: that make up the height.
        dots: drawn as dots at their points, below the lines.
        areas: drawn below all.
        is_timed: whether x is a time in seconds, shared with the page's other charts.
    """
    heights = SIDE * (1 - y.at(np.array([value for value, _ in y.ticks])))
    shapes = [
        f'<line class="grid" x1="0" x2="{SIDE}" y1="{at:.1f}" y2="{at:.1f}"/>' for at in heights
    ]
    shapes += [_area(area, x, y) for area in areas]
    shapes += [
        f'<path class="dots {cloud.style}" style="--c:{cloud.color}" d="'
        + "".join(
            f"M{px:.0f} {py:.0f}h0"
            for px, py in zip(x.at(cloud.x) * SIDE, (1 - y.at(cloud.y)) * SIDE, strict=True)
        )
        + '"/>'
        for cloud in dots
    ]
    shapes += [
        path(line, *_thinned(x.at(line.x) * SIDE, (1 - y.at(line.y)) * SIDE), is_timed=is_timed)
        for line in lines
        if _known(line)
    ]
    words = [
        f'<span class="tick y" style="bottom:{100 * at:.2f}%">{escape(text)}</span>'
        for at, text in _placed(y)
    ]
    words += [
        f'<span class="tick x" style="left:{100 * at:.2f}%">{escape(text)}</span>'
        for at, text in _placed(x)
    ]
    moment = f' data-span="{x.low:.3f},{x.high:.3f}" data-range="{y.low:g},{y.high:g}"'
    return (
        f'<figure class="chart time">{caption(title, [*areas, *lines, *dots], is_timed=is_timed)}'
        f'<div class="plot" style="--h:{_ROW_REM * rows + 1}rem"{moment if is_timed else ""}>'
        f'<svg viewBox="0 0 {SIDE} {SIDE}" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape(title)}">{"".join(shapes)}</svg>{"".join(words)}</div></figure>'
    )


def _placed(axis: Axis) -> list[tuple[float, str]]:
    """The position of each tick's label along the axis."""
    at = axis.at(np.array([value for value, _ in axis.ticks]))
    return [(float(place), text) for place, (_, text) in zip(at, axis.ticks, strict=True)]


def bars(values: dict[str, float], unit: str, color: str) -> str:
    """Horizontal bars with their values, in the order given."""
    longest = max(values.values(), default=0.0) or 1.0
    rows = [
        f'<span>{escape(name)}</span><div style="--c:{color};width:{100 * value / longest:.1f}%">'
        f"</div><span>{value:.1f} {escape(unit)}</span>"
        for name, value in values.items()
    ]
    return f'<div class="bars">{"".join(rows)}</div>'


def _known(line: Line) -> bool:
    return bool(np.isfinite(line.y).any())


def caption(title: str, lines: Sequence[Line | Area], *, is_timed: bool = False) -> str:
    """The title of a figure, the keys of its lines, and room for values at the pointer."""
    # a single line is described by the title
    named = lines if len(lines) > 1 else ()
    said = "<output></output>" if is_timed else ""
    return f"<figcaption><b>{escape(title)}</b>{_keys(named)}{said}</figcaption>"


def legend(lines: Sequence[Line]) -> str:
    """A legend for several charts of the same lines."""
    return f'<div class="legend">{_keys(lines)}</div>'


def _keys(lines: Sequence[Line | Area]) -> str:
    return "".join(
        key(line.label, line.color, line.style if isinstance(line, Line) else "area")
        for line in lines
        if line.label
    )


def key(label: str, color: str, style: str) -> str:
    """A colour and its meaning."""
    return f'<span class="key {style}" style="--c:{color}"><i></i>{escape(label)}</span>'


def path(line: Line, x: Float64, y: Float64, *, is_timed: bool = False) -> str:
    """A line through points in units of the drawing; an isolated point is a dot.

    Args:
        line: its style.
        x: float64 [N].
        y: float64 [N]; NaN breaks the line.
        is_timed: whether a pointer can show its value.
    """
    drawn = "".join(_stretch(x[rows], y[rows]) for rows in _stretches(y))
    value = f' data-value="{escape(line.label)}"' if is_timed else ""
    alone = [rows.start for rows in _stretches(y) if rows.stop - rows.start == 1]
    dots = "".join(_stretch(x[i : i + 1], y[i : i + 1]) for i in alone)
    return f'<path class="{line.style}" style="--c:{line.color}"{value} d="{drawn}"/>' + (
        f'<path class="lone" style="--c:{line.color}" d="{dots}"/>' if dots else ""
    )


def _stretch(x: Float64, y: Float64) -> str:
    points = "L".join(f"{px:.1f} {py:.1f}" for px, py in zip(x, y, strict=True))
    return f"M{points}{'h0' if len(x) == 1 else ''}"


def _stretches(y: Float64) -> list[slice]:
    """The parts of a line between unknown points."""
    known = np.concatenate([[0], np.isfinite(y), [0]]).astype(np.int8)
    starts, stops = np.flatnonzero(np.diff(known) == 1), np.flatnonzero(np.diff(known) == -1)
    return [slice(a, b) for a, b in zip(starts.tolist(), stops.tolist(), strict=True)]


def _area(area: Area, x: Axis, y: Axis) -> str:
    every = slice(None, None, max(1, len(area.x) // _COLUMNS))
    px, low, high = area.x[every], area.low[every], area.high[every]
    outlines = []
    for rows in _stretches(high):
        across = np.concatenate([x.at(px[rows]), x.at(px[rows])[::-1]]) * SIDE
        # the axis may be shorter
        heights = np.concatenate([y.at(high[rows]), y.at(low[rows])[::-1]]).clip(0, 1)
        outlines.append(f"{_stretch(across, (1 - heights) * SIDE)}Z")
    return f'<path class="area" style="--c:{area.color}" d="{"".join(outlines)}"/>'


def _thinned(x: Float64, y: Float64) -> tuple[Float64, Float64]:
    """The minimum and maximum y of each column, so that no peak is lost in a long recording."""
    if len(x) <= 2 * _COLUMNS:
        return x, y
    rows: list[int] = []
    for column in np.array_split(np.arange(len(x)), _COLUMNS):
        known = column[np.isfinite(y[column])]
        if len(known):
            rows += sorted({int(known[np.argmin(y[known])]), int(known[np.argmax(y[known])])})
        else:
            rows.append(int(column[0]))
    return x[rows], y[rows]
