"""``report.html`` of compared runs: their tables, and all trajectories in one plot."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.experiments.compare.comparison import (
    Comparison,
    figures_table,
    parameters_text,
)
from rgbd_glue_ros.experiments.report import charts
from rgbd_glue_ros.experiments.report.axes import rising
from rgbd_glue_ros.experiments.report.charts import Line
from rgbd_glue_ros.experiments.report.colophon import Colophon
from rgbd_glue_ros.experiments.report.from_markdown import from_markdown
from rgbd_glue_ros.experiments.report.page import page
from rgbd_glue_ros.experiments.report.plans import plans
from rgbd_glue_ros.experiments.report.series_colors import CSS, look
from rgbd_glue_ros.types import NANOSECONDS, Float64

_ROWS = 5
_CSS = "h1 + .wide { margin-top: 1.2rem; }\n"


def render(comparison: Comparison, command: str) -> str:
    """The page.

    Args:
        comparison: of the runs.
        command: the command line; "" if it was started by a program.
    """
    recording = comparison.runs[0].recording
    parts = [
        *from_markdown(figures_table(comparison), {}),
        "<p>In brackets the ratio to the first run.</p>",
        *_trajectories(comparison),
        "<h2>Parameters that differ</h2>",
        *from_markdown(parameters_text(comparison.runs), {}),
        str(Colophon.now(command, recording)),
    ]
    return page(f"{recording}: {len(comparison.runs)} runs", parts, CSS + _CSS)


def _trajectories(comparison: Comparison) -> list[str]:
    """Two views of all trajectories, and the distance of each from the first over time."""
    first = comparison.runs[0].trajectory
    if first is None:
        return ["<h2>Trajectories</h2><p>No frame of the first run has a pose.</p>"]
    since_ns = int(first.stamps_ns[0])
    tracks = [(*look(0), comparison.runs[0].name, first.stamps_ns, first.poses)]
    for i, (run, apart) in enumerate(zip(comparison.runs, comparison.apart, strict=True)):
        if run.trajectory is not None and apart is not None:
            poses = apart.T_reference_estimate @ run.trajectory.poses
            tracks.append((*look(i), run.name, run.trajectory.stamps_ns, poses))
    above = [Line(n, color, p[:, 0, 3], p[:, 2, 3], style) for color, style, n, _, p in tracks]
    beside = [Line(n, color, p[:, 2, 3], -p[:, 1, 3], style) for color, style, n, _, p in tracks]
    times: Float64 = (tracks[-1][3] - since_ns) / NANOSECONDS
    text = (
        "<h2>Trajectories</h2><p>In the axes of the first camera of the first run; the others are "
        "aligned with it by rotation and translation. The ends of the last are green and red.</p>"
    )
    return [
        text,
        plans(
            [
                ("From above (right, forward)", above, times),
                ("From the side (forward, up)", beside, times),
            ]
        ),
        _distances(comparison, since_ns),
    ]


def _distances(comparison: Comparison, since_ns: int) -> str:
    lines = [
        Line(
            run.name,
            look(i)[0],
            np.asarray((apart.stamps_ns - since_ns) / NANOSECONDS, np.float64),
            100 * apart.errors_m,
        )
        for i, (run, apart) in enumerate(zip(comparison.runs, comparison.apart, strict=True))
        if apart is not None
    ]
    if not lines:
        return ""
    seconds = np.concatenate([line.x for line in lines])
    # runs that are the same to the last digit are 0 apart, and an axis needs a length
    furthest = max(float(np.max([line.y.max() for line in lines])), 0.01)
    whose = f" of {lines[0].label}" if len(lines) == 1 else ""
    return charts.chart(
        f"Distance{whose} from the first run, cm",
        lines,
        (float(seconds.min()), float(seconds.max())),
        _ROWS,
        rising(furthest, _ROWS),
    )
