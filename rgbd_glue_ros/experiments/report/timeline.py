"""Bands over time, and a pointer that shows one moment in all charts of a page."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from rgbd_glue_ros.experiments.report.charts import key
from rgbd_glue_ros.experiments.report.escaping import escape
from rgbd_glue_ros.types import Float64

CSS = """
.band { position: relative; height: 1.5rem; margin: 0 0 1.6rem 2.9rem; border-radius: 4px;
  overflow: hidden; background: var(--line); }
.band div { position: absolute; top: 0; bottom: 0; background: var(--c); min-width: 1px; }
.band div.mark { width: 1px; top: 55%; background: var(--page); opacity: .85; }
[data-span] { touch-action: pan-y; cursor: crosshair; }
.cursor { position: absolute; top: 0; bottom: 0; width: 0; border-left: 1px solid var(--text);
  display: none; pointer-events: none; }
.band div.cursor { background: none; min-width: 0; }
.chart output { position: absolute; right: 0; bottom: .55rem; color: var(--text);
  font-size: .78rem; line-height: 1; font-variant-numeric: tabular-nums; white-space: nowrap; }
"""

# The value under the pointer is read from the drawn lines: the page has no second copy of them.
SCRIPT = """
(() => {
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];
  const numbers = (text) => text.split(",").map(Number);
  const nearest = (points, at, most) => {
    let best = null;
    for (const p of points) if (!best || Math.abs(p[0] - at) < Math.abs(best[0] - at)) best = p;
    return best && Math.abs(best[0] - at) <= most ? best : null;
  };
  const timed = all("[data-span]").map((box) => {
    const cursor = box.appendChild(document.createElement("div"));
    cursor.className = "cursor";
    const lines = all("path[data-value]", box).map((path) => ({
      label: path.dataset.value,
      points: [...path.getAttribute("d").matchAll(/[ML]([-\\d.]+) ([-\\d.]+)/g)].map(
        (m) => [Number(m[1]), Number(m[2])]),
    }));
    return { box, cursor, lines, span: numbers(box.dataset.span),
      range: numbers(box.dataset.range || "0,1"), said: box.parentNode.querySelector("output") };
  });
  const dots = all("[data-moments]").map((dot) => ({
    dot, moments: dot.dataset.moments.split(" ").filter(Boolean).map(numbers) }));
  const show = (time) => {
    for (const { cursor, lines, span, range, said } of timed) {
      const at = (time - span[0]) / (span[1] - span[0] || 1);
      cursor.style.left = `${100 * at}%`;
      cursor.style.display = "block";
      if (!said) continue;
      const values = lines.flatMap(({ label, points }) => {
        const p = nearest(points, 1000 * at, 15);
        if (!p) return [];
        const value = range[1] - (p[1] / 1000) * (range[1] - range[0]);
        return [`${label} ${Number(value.toPrecision(3))}`.trim()];
      });
      said.textContent = `${time.toFixed(2)} s: ${values.join(", ") || "nothing"}`;
    }
    for (const { dot, moments } of dots) {
      const p = nearest(moments, time, Infinity);
      if (p) dot.setAttribute("d", `M${p[1]} ${p[2]}h0`);
      dot.classList.toggle("on", Boolean(p));
    }
  };
  const hide = () => {
    for (const { cursor, said } of timed) {
      cursor.style.display = "none";
      if (said) said.textContent = "";
    }
    for (const { dot } of dots) dot.classList.remove("on");
  };
  for (const { box, span } of timed) {
    const follow = (event) => {
      const area = box.getBoundingClientRect();
      const at = Math.min(1, Math.max(0, (event.clientX - area.left) / area.width));
      show(span[0] + at * (span[1] - span[0]));
    };
    box.addEventListener("pointermove", follow);
    box.addEventListener("pointerdown", follow);
    box.addEventListener("pointerleave", hide);
  }
  for (const moment of all("[data-at]")) {
    moment.addEventListener("pointerenter", () => show(Number(moment.dataset.at)));
    moment.addEventListener("pointerleave", hide);
  }
})();
"""


@dataclass(frozen=True)
class Span:
    """A coloured part of a band, in fractions of its length."""

    start: float
    stop: float
    color: str


def band(
    title: str,
    keys: Iterable[tuple[str, str]],
    spans: Iterable[Span],
    marks: Float64,
    time_range: tuple[float, float],
) -> str:
    """A band of coloured spans with thin marks.

    Args:
        title: of the band.
        keys: label and colour of each kind of span.
        spans: to draw.
        marks: float64 [N], fractions of the length.
        time_range: its ends, seconds.
    """
    drawn = [
        f'<div style="--c:{span.color};left:{100 * span.start:.3f}%;'
        f'width:{100 * (span.stop - span.start):.3f}%"></div>'
        for span in spans
    ]
    drawn += [f'<div class="mark" style="left:{100 * mark:.3f}%"></div>' for mark in marks]
    named = "".join(key(label, color, "") for label, color in keys)
    return (
        f'<figure class="chart"><figcaption><b>{escape(title)}</b>{named}</figcaption>'
        f'<div class="band" data-span="{time_range[0]:.3f},{time_range[1]:.3f}">'
        f"{''.join(drawn)}</div></figure>"
    )
