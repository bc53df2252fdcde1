"""Error against time of all contestants, as an SVG file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rgbd_glue_ros.experiments.report.escaping import escape
from rgbd_glue_ros.experiments.report.labels import Box, placed

PICTURE = "bench.svg"

_WIDTH, _HEIGHT = 420, 320
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 16, 34, 44
_COLUMNS = 2
_TEXT, _QUIET, _LINE, _OURS, _PEER = "#16202c", "#5d6b7b", "#e3e7ec", "#1d5fd1", "#c2620a"
_RADIUS, _FONT_PX = 5, 11


def picture(sequences: Mapping[str, Any], ours: str) -> str | None:
    """One panel per sequence, both axes logarithmic; lower left is better.

    Args:
        sequences: as in ``bench.json``.
        ours: the contestant to highlight.

    Returns:
        The file's content; None if no contestant has both a time and an error.
    """
    panels = {}
    for name, content in sequences.items():
        points = {
            who: (result["wall_ms"]["p50"], 100 * result["rpe"]["trans_rmse_m"])
            for who, result in content["contest"].items()
            if result.get("rpe") and "wall_ms" in result
        }
        if points:
            panels[name] = points
    if not panels:
        return None
    columns = min(_COLUMNS, len(panels))
    width, height = columns * _WIDTH, -(-len(panels) // columns) * _HEIGHT
    body = "".join(
        f'<g transform="translate({i % columns * _WIDTH} {i // columns * _HEIGHT})">'
        f"{_panel(name, points, ours)}</g>"
        for i, (name, points) in enumerate(panels.items())
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" font-family="system-ui, sans-serif" '
        f'font-size="{_FONT_PX}">'
        f'<rect width="{width}" height="{height}" fill="#fff"/>{body}</svg>\n'
    )


def _panel(name: str, points: Mapping[str, tuple[float, float]], ours: str) -> str:
    x_ticks, y_ticks = (_decades([p[axis] for p in points.values()]) for axis in (0, 1))
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM

    def place(value: float, ticks: list[float], start: float, end: float) -> float:
        low, high = np.log(ticks[0]), np.log(ticks[-1])
        return float(start + (np.log(value) - low) / (high - low) * (end - start))

    drawn = [_word(_LEFT, 20, name, _TEXT, weight=600)]
    for tick in x_ticks:
        x = place(tick, x_ticks, _LEFT, right)
        drawn.append(_rule(x, x, _TOP, bottom))
        drawn.append(_word(x, bottom + 15, f"{tick:g}", _QUIET, "middle"))
    for tick in y_ticks:
        y = place(tick, y_ticks, bottom, _TOP)
        drawn.append(_rule(_LEFT, right, y, y))
        drawn.append(_word(_LEFT - 6, y + 4, f"{tick:g}", _QUIET, "end"))
    drawn.append(_word((_LEFT + right) / 2, bottom + 33, "ms per frame, median", _QUIET, "middle"))
    drawn.append(
        f'<text transform="translate(14 {(_TOP + bottom) / 2:.1f}) rotate(-90)" fill="{_QUIET}" '
        'text-anchor="middle">RPE, cm/s</text>'
    )
    dots = {
        who: (place(ms, x_ticks, _LEFT, right), place(cm, y_ticks, bottom, _TOP))
        for who, (ms, cm) in points.items()
    }
    boxes = placed(dots, _RADIUS, _FONT_PX, Box(_LEFT, _TOP, right, bottom))
    for who, (x, y) in dots.items():
        color, weight = (_OURS, 600) if who == ours else (_PEER, 400)
        drawn.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{_RADIUS}" fill="{color}"/>')
        box = boxes[who]
        middle = (box.left + box.right) / 2, box.bottom - 2
        drawn.append(_word(*middle, who, color, "middle", weight=weight))
    return "".join(drawn)


def _decades(values: list[float]) -> list[float]:
    """Ticks 1, 2, 5, 10, … that enclose all values."""
    low, high = max(min(values), 1e-6), max(*values, 2e-6)
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    every = [float(f"{step * 10.0**power:.6g}") for power in powers for step in (1, 2, 5)]
    first = max(i for i, tick in enumerate(every) if tick <= low)
    last = min(i for i, tick in enumerate(every) if tick >= high)
    return every[first : max(last, first + 1) + 1]


def _rule(x1: float, x2: float, y1: float, y2: float) -> str:
    return f'<line x1="{x1:.1f}" x2="{x2:.1f}" y1="{y1:.1f}" y2="{y2:.1f}" stroke="{_LINE}"/>'


def _word(
    x: float, y: float, text: str, color: str, anchor: str = "start", weight: int = 400
) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" fill="{color}" text-anchor="{anchor}" '
        f'font-weight="{weight}">{escape(text)}</text>'
    )
