"""Charts as self-contained HTML: shapes in SVG, words beside it so that they keep their size.

Shapes are drawn in a square of ``SIDE`` units that the page stretches to any width.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from rgbd_glue_ros.experiments.report.axes import Axis, linear, rising, ticks
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
.time .plot { margin-bottom: 2.9rem; }
.plot svg { position: absolute; inset: 0; width: 100%; height: 100%; overflow: visible; }
.plot path, .plot line { fill: none; vector-effect: non-scaling-stroke; stroke: var(--c);
  stroke-width: 1.6; stroke-linejoin: round; stroke-linecap: round; }
.plot .grid { stroke: var(--line); stroke-width: 1; }
.plot .dashed { stroke-dasharray: 5 4; stroke-width: 1.3; }
.plot .thick { stroke-width: 3.2; }
.plot .dot { stroke-width: 9; }
.plot .dots { stroke-width: 6; opacity: .5; }
.tick { position: absolute; color: var(--quiet); font-size: .72rem; line-height: 1;
  font-variant-numeric: tabular-nums; white-space: nowrap; }
.tick.y { right: calc(100% + .5rem); transform: translateY(50%); }
.tick.x { top: calc(100% + .45rem); transform: translateX(-50%); }
.plan .plot { margin: 0; height: auto; aspect-ratio: var(--ratio); }
.scale { position: absolute; right: 0; bottom: 0; color: var(--quiet); font-size: .72rem;
  border: solid var(--quiet); border-width: 0 1px 1px; padding: 0 0 .25rem; text-align: center;
  line-height: 1; }
.bars { display: grid; grid-template-columns: max-content 1fr max-content; gap: .45rem .8rem;
  align-items: center; font-size: .88rem; }
.bars div { height: .85rem; border-radius: 3px; background: var(--c); min-width: 2px; }
.bars span:nth-child(3n) { text-align: right; font-variant-numeric: tabular-nums; }
.band { position: relative; height: 1.5rem; margin: 0 0 1.6rem 2.9rem; border-radius: 4px;
  overflow: hidden; background: var(--line); }
.band div { position: absolute; top: 0; bottom: 0; background: var(--c); min-width: 1px; }
.band div.mark { width: 1px; top: 55%; background: var(--page); opacity: .85; }
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


def chart(title: str, lines: Sequence[Line], x_range: tuple[float, float], rows: int) -> str:
    """Lines over a common x axis in seconds, with the y axis from zero.

    Args:
        title: with the unit of y.
        lines: to draw, the last on top.
        x_range: ends of the x axis.
        rows: of grid lines, about; the height follows from it.
    """
    highest = max((float(np.nanmax(line.y)) for line in lines if _known(line)), default=1.0)
    return plot(title, lines, linear(*x_range, " s"), rising(highest, rows), rows)


def plot(
    title: str,
    lines: Sequence[Line],
    x: Axis,
    y: Axis,
    rows: int,
    dots: Sequence[Line] = (),
) -> str:
    """Lines and dots in a plane.

    Args:
        title: of the figure.
        lines: to draw, the last on top.
        x: the axis to the right.
        y: the axis upward, with a grid line at each tick.
        rows: that make up the height.
        dots: drawn as dots at their points, below the lines.
    """
    heights = SIDE * (1 - y.at(np.array([value for value, _ in y.ticks])))
    shapes = [
        f'<line class="grid" x1="0" x2="{SIDE}" y1="{at:.1f}" y2="{at:.1f}"/>' for at in heights
    ]
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
        _path(line, *_thinned(x.at(line.x) * SIDE, (1 - y.at(line.y)) * SIDE))
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
    return (
        f'<figure class="chart time">{_caption(title, [*lines, *dots])}'
        f'<div class="plot" style="--h:{_ROW_REM * rows + 1}rem">'
        f'<svg viewBox="0 0 {SIDE} {SIDE}" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape(title)}">{"".join(shapes)}</svg>{"".join(words)}</div></figure>'
    )


def _placed(axis: Axis) -> list[tuple[float, str]]:
    """Where along the axis each tick's text is."""
    at = axis.at(np.array([value for value, _ in axis.ticks]))
    return [(float(place), text) for place, (_, text) in zip(at, axis.ticks, strict=True)]


def plan(title: str, lines: Sequence[Line]) -> str:
    """Lines in a plane with equal axes, x to the right and y up, and a bar that shows a length.

    The first point of the last line is marked green, its last one red.
    """
    xy = np.concatenate([np.stack([line.x, line.y]) for line in lines], axis=1)
    low, high = xy.min(axis=1), xy.max(axis=1)
    # neither a flat nor a slim picture, and room for the strokes at the edge
    extent = (high - low).max() or 1.0
    size = np.maximum(high - low, 0.55 * extent) + 0.08 * extent
    corner = (low + high - size) / 2
    scale = SIDE / size[0]
    height = SIDE * size[1] / size[0]
    drawn = []
    for line in lines:
        x, y = (line.x - corner[0]) * scale, height - (line.y - corner[1]) * scale
        kept = _spaced(x, y)
        drawn.append(_path(line, x[kept], y[kept]))
        ends = (x[0], y[0], "var(--good)"), (x[-1], y[-1], "var(--bad)")
    drawn += [
        f'<path class="dot" style="--c:{color}" d="M{px:.1f} {py:.1f}h0"/>'
        for px, py, color in ends
    ]
    bar = max(value for value in ticks(0.0, 0.4 * size[0]) if value <= 0.4 * size[0])
    length = f"{bar:g} m" if bar >= 1 else f"{100 * bar:g} cm"
    return (
        f'<figure class="chart plan">{_caption(title, lines)}'
        f'<div class="plot" style="--ratio:{SIDE}/{height:.0f}">'
        f'<svg viewBox="0 0 {SIDE} {height:.0f}" role="img" aria-label="{escape(title)}">'
        f"{''.join(drawn)}</svg>"
        f'<span class="scale" style="width:{100 * bar / size[0]:.2f}%">{length}</span>'
        "</div></figure>"
    )


@dataclass(frozen=True)
class Span:
    """A coloured part of a band, in fractions of its length."""

    start: float
    stop: float
    color: str


def band(title: str, keys: Iterable[tuple[str, str]], spans: Iterable[Span], marks: Float64) -> str:
    """A band of coloured spans with thin marks.

    Args:
        title: of the band.
        keys: label and colour of each kind of span.
        spans: to draw.
        marks: float64 [N], fractions of the length.
    """
    drawn = [
        f'<div style="--c:{span.color};left:{100 * span.start:.3f}%;'
        f'width:{100 * (span.stop - span.start):.3f}%"></div>'
        for span in spans
    ]
    drawn += [f'<div class="mark" style="left:{100 * mark:.3f}%"></div>' for mark in marks]
    named = "".join(_key(label, color, "") for label, color in keys)
    return (
        f'<figure class="chart"><figcaption><b>{escape(title)}</b>{named}</figcaption>'
        f'<div class="band">{"".join(drawn)}</div></figure>'
    )


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


def _caption(title: str, lines: Sequence[Line]) -> str:
    # one line alone is what the title says
    named = lines if len(lines) > 1 else ()
    return f"<figcaption><b>{escape(title)}</b>{_keys(named)}</figcaption>"


def legend(lines: Sequence[Line]) -> str:
    """A legend for several charts of the same lines."""
    return f'<div class="legend">{_keys(lines)}</div>'


def _keys(lines: Sequence[Line]) -> str:
    return "".join(_key(line.label, line.color, line.style) for line in lines if line.label)


def _key(label: str, color: str, style: str) -> str:
    return f'<span class="key {style}" style="--c:{color}"><i></i>{escape(label)}</span>'


def _path(line: Line, x: Float64, y: Float64) -> str:
    words: list[str] = []
    pen = "M"
    for px, py in zip(x, y, strict=True):
        if not np.isfinite(py):
            pen = "M"
            continue
        words.append(f"{pen}{px:.1f} {py:.1f}")
        pen = "L"
    return f'<path class="{line.style}" style="--c:{line.color}" d="{"".join(words)}"/>'


def _thinned(x: Float64, y: Float64) -> tuple[Float64, Float64]:
    """The least and greatest y of each column, so that no peak is lost in a long recording."""
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


def _spaced(x: Float64, y: Float64) -> list[int]:
    """Rows of points that lie apart by more than anybody sees."""
    kept = [0]
    for i in range(1, len(x)):
        if abs(x[i] - x[kept[-1]]) + abs(y[i] - y[kept[-1]]) > 1.0:
            kept.append(i)
    return [*kept, len(x) - 1]
