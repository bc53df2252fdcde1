"""The report of a run: one self-contained HTML page."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import replace
from itertools import groupby
from typing import Any

import numpy as np

from rgbd_glue_ros.evaluation.trajectory_errors import RPE_DELTA_S, Evaluation
from rgbd_glue_ros.experiments.replay.moments import CSS as MOMENTS_CSS
from rgbd_glue_ros.experiments.replay.moments import moments
from rgbd_glue_ros.experiments.replay.run_record import Run
from rgbd_glue_ros.experiments.replay.series import error_charts, since_start, with_gaps
from rgbd_glue_ros.experiments.report import charts
from rgbd_glue_ros.experiments.report.axes import linear, rising
from rgbd_glue_ros.experiments.report.charts import Line
from rgbd_glue_ros.experiments.report.colophon import Colophon
from rgbd_glue_ros.experiments.report.page import (
    SIDE_BY_SIDE,
    changed_parameters,
    notes,
    page,
    tiles,
)
from rgbd_glue_ros.experiments.report.plans import plans
from rgbd_glue_ros.experiments.report.timeline import Span, band
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.trajectories.association import MAX_TIME_DIFFERENCE_S
from rgbd_glue_ros.types import EdgeOrigin, Float64, TrackingState

_UNANSWERED = None
_STATES: dict[TrackingState | None, tuple[str, str]] = {
    TrackingState.TRACKING: ("tracking", "var(--good)"),
    TrackingState.INITIALIZING: ("initializing", "var(--wait)"),
    TrackingState.LOST: ("lost", "var(--bad)"),
    _UNANSWERED: ("dropped, or without a pose", "var(--truth)"),
}
_TALL, _LOW = 5, 3
_ERRORS = (
    "<p>APE: distance of positions after alignment by rotation and translation (no "
    f"scale), poses nearest in time, one-to-one, within {MAX_TIME_DIFFERENCE_S:g} s. "
    f"RPE: error of the motion over every pair of poses {RPE_DELTA_S:g} s apart.</p>"
)
_CSS = ".map { display: block; width: 100%; border-radius: 6px; }\n"


def render(
    run: Run, figures: Mapping[str, Any], evaluation: Evaluation | None, colophon: Colophon
) -> str:
    """The page.

    Args:
        run: with at least one frame.
        figures: its ``metrics``.
        evaluation: of its trajectory; None without ground truth.
        colophon: how it was produced.
    """
    stamps_ns = np.array([frame.stamp_ns for frame in run.frames], np.int64)
    seconds = since_start(run, stamps_ns)
    parts = [
        notes(run.warnings),
        _summary(run, figures, seconds),
        _tiles(figures),
        _trajectory(run, evaluation),
        _map(run),
        "<h2>Over time</h2>",
        _states(run),
        *_charts(run, seconds, evaluation),
        *moments(run, evaluation),
        *_stages(figures["stages_ms"]),
        "<h2>All figures</h2>",
        _figures(figures),
        "<h2>Parameters that differ from the defaults</h2>",
        changed_parameters(run.config),
        str(colophon),
    ]
    return page(run.sequence, parts, MOMENTS_CSS + _CSS)


def _summary(run: Run, figures: Mapping[str, Any], seconds: Float64) -> str:
    frames, played = figures["frames"], figures["played"]
    processed = f"{frames} frames" if frames == played else f"{frames} of {played} frames processed"
    return f"<p>{processed}, {seconds[-1]:.1f} s of recording, done in {run.wall_s:.1f} s.</p>"


def _tiles(figures: Mapping[str, Any]) -> str:
    # 100 is all of them
    tracked = f"{np.floor(1000 * figures['tracked'] / figures['frames']) / 10:g}"
    is_live = "node_latency_ms" in figures
    which = "frames" if figures["frames"] == figures["played"] else "frames processed"
    shown = []
    if "ape" in figures:
        what = "position error, rmse (APE)"
        if figures.get("odometry"):
            before = 100 * figures["odometry"]["ape"]["rmse_m"]
            what += f"; of the odometry {before:.2f} cm"
        shown.append((f"{100 * figures['ape']['rmse_m']:.2f}", "cm", what))
    if figures.get("rpe"):
        rpe = figures["rpe"]
        shown.append((f"{100 * rpe['trans_rmse_m']:.2f}", "cm/s", "drift, rmse (RPE)"))
        shown.append((f"{rpe['rot_rmse_deg']:.2f}", "°/s", "rotation drift, rmse (RPE)"))
    shown += [
        (tracked, "%", f"of {which} tracked, {figures['lost']} lost"),
        (f"{figures['latency_ms']['p50']:.1f}", "ms", "median latency per frame"),
        (f"{figures['fps']:.1f}", "fps", "poses of the node" if is_live else "with decoding"),
    ]
    return tiles(shown)


def _trajectory(run: Run, evaluation: Evaluation | None) -> str:
    trajectory = run.trajectory
    if not len(trajectory):
        return "<h2>Trajectory</h2><p>No frame has a pose.</p>"
    times, poses = with_gaps(replace(run, unanswered_ns=()), trajectory.stamps_ns, trajectory.poses)
    tracks = []
    if evaluation is not None:
        # the ground truth, aligned with the estimate, so that the picture has the first camera's
        # axes
        truth = se3.inverse(evaluation.T_reference_estimate) @ evaluation.reference
        tracks.append(("ground truth", "var(--truth)", truth[:, :3, 3], "thick"))
    if run.uncorrected is not None:
        before = with_gaps(
            replace(run, unanswered_ns=()), run.uncorrected.stamps_ns, run.uncorrected.poses
        )[1]
        tracks.append(("before loops", "var(--quiet)", before[:, :3, 3], "dashed"))
    loops = _loops(run)
    if len(loops):
        tracks.append(("loops", "var(--geometric)", loops, ""))
    tracks.append(("estimate", "var(--estimate)", poses[:, :3, 3], ""))
    above = [Line(name, color, p[:, 0], p[:, 2], style) for name, color, p, style in tracks]
    beside = [Line(name, color, p[:, 2], -p[:, 1], style) for name, color, p, style in tracks]
    aligned = "; the ground truth is aligned with it by rotation and translation"
    return (
        "<h2>Trajectory</h2><p>In the axes of the first camera, from the green to the red end"
        f"{aligned if evaluation else ''}. Both views have the same scale.</p>"
        + plans(
            [
                ("From above (right, forward)", above, times),
                ("From the side (forward, up)", beside, times),
            ]
        )
    )


def _loops(run: Run) -> Float64:
    """Both ends of each loop, and NaN, in turn: positions [N, 3] that make a broken line."""
    graph = run.pose_graph
    at = graph.keyframes.poses[:, :3, 3]
    rows = [(e.parent, e.child) for e in graph.edges if e.origin is EdgeOrigin.LOOP]
    apart = np.full(3, np.nan)
    points = [p for i, j in rows if max(i, j) < len(at) for p in (at[i], at[j], apart)]
    return np.array(points, np.float64).reshape(-1, 3)


def _map(run: Run) -> str:
    """The picture of the map, if there is one."""
    if not run.map_jpeg:
        return ""
    jpeg = base64.b64encode(run.map_jpeg).decode()
    return (
        "<h2>Map</h2><p>What the keyframes saw, at their final poses, and the camera's path. "
        "Duplicate walls and edges would show an error.</p>"
        f'<img class="map" src="data:image/jpeg;base64,{jpeg}" alt="the map from above" />'
    )


def _states(run: Run) -> str:
    states: dict[int, TrackingState | None] = dict.fromkeys(run.unanswered_ns, _UNANSWERED)
    states |= {frame.stamp_ns: frame.state for frame in run.frames}
    in_order = sorted(states.items())
    seconds = since_start(run, np.array([stamp_ns for stamp_ns, _ in in_order], np.int64))
    first, last = float(seconds[0]), float(seconds[-1])
    # a frame's state holds until the next frame
    edges = (np.append(seconds, last) - first) / ((last - first) or 1.0)
    spans, start = [], 0
    for state, group in groupby(in_order, key=lambda item: item[1]):
        stop = start + len(list(group))
        spans.append(Span(edges[start], edges[stop], _STATES[state][1]))
        start = stop
    marked = np.array([f.stamp_ns for f in run.frames if f.is_keyframe], np.int64)
    marks = (since_start(run, marked) - first) / ((last - first) or 1.0)
    keys = [key for state, key in _STATES.items() if state in set(states.values())]
    ticks = "a tick for the keyframe" if len(marked) == 1 else f"a tick for each of {len(marked)}"
    title = f"State, and {ticks}{'' if len(marked) == 1 else ' keyframes'}"
    return band(title, keys, spans, marks, (first, last))


def _charts(run: Run, seconds: Float64, evaluation: Evaluation | None) -> list[str]:
    span = (float(seconds.min()), float(seconds.max()))
    drawn = []
    stamps_ns = np.array([frame.stamp_ns for frame in run.frames], np.int64)
    if evaluation is not None:
        drawn += error_charts(run, evaluation, span)
    for title, color, numbers in (
        ("Visual inliers", "var(--estimate)", [frame.visual_inliers for frame in run.frames]),
        (
            "Credible geometric matches",
            "var(--geometric)",
            [frame.credible for frame in run.frames],
        ),
    ):
        y = np.array(numbers, np.float64)
        # a node does not publish them with each pose
        if np.isfinite(y).any():
            drawn.append(
                charts.chart(title, [Line("", color, *with_gaps(run, stamps_ns, y))], span, _LOW)
            )
    drawn.append(_latency(run, span))
    return drawn


def _latency(run: Run, span: tuple[float, float]) -> str:
    stamps_ns = np.array([frame.stamp_ns for frame in run.frames], np.int64)
    latency = np.array([frame.latency_ms for frame in run.frames])
    offered = since_start(run, np.sort(np.append(stamps_ns, run.unanswered_ns)).astype(np.int64))
    interval = 1000 * float(np.median(np.diff(offered))) if len(offered) > 1 else float("nan")
    # a frame of seconds, which compiles code or waits for a disk, would hide all others
    y = rising(1.5 * float(np.nanmax([interval, np.percentile(latency, 95)])), _TALL)
    is_shown = latency <= y.high
    x, shown = with_gaps(run, stamps_ns, np.where(is_shown, latency, np.nan))
    lines = [
        Line("between frames", "var(--quiet)", x, np.full(len(x), interval), "dashed"),
        Line("per frame", "var(--estimate)", x, shown),
    ]
    beyond = since_start(run, stamps_ns[~is_shown])
    text, dots = "", []
    if len(beyond):
        dots = [Line("longer", "var(--bad)", beyond, np.full(len(beyond), y.high))]
        text = (
            f"<p>Red at the top edge: longer than that, up to {latency.max():.0f} ms "
            f"(at {since_start(run, stamps_ns)[latency.argmax()]:.1f} s).</p>"
        )
    drawn = charts.plot(
        "Latency, ms", lines, linear(*span, " s"), y, _TALL, dots=dots, is_timed=True
    )
    return drawn + text


def _stages(medians: Mapping[str, float]) -> list[str]:
    """The section about stages; none if they were not timed, as in a node."""
    if not medians:
        return []
    named = {name.replace("_", " "): value for name, value in medians.items()}
    return [
        "<h2>Where the time goes</h2>",
        f"<p>Median of each stage. {SIDE_BY_SIDE}</p>",
        charts.bars(named, "ms", "var(--estimate)"),
    ]


_Table = tuple[str, list[tuple[str, str]]]
"""A caption, and the name and value of each row."""


def _figures(figures: Mapping[str, Any]) -> str:
    tables = [*_error_tables(figures), _tracking_table(figures), _speed_table(figures)]
    body = "".join(
        f"<table><caption>{title}</caption>"
        + "".join(f'<tr><td>{name}</td><td class="n">{value}</td></tr>' for name, value in rows)
        + "</table>"
        for title, rows in tables
    )
    return f'{_ERRORS if "ape" in figures else ""}<div class="two">{body}</div>'


def _error_tables(figures: Mapping[str, Any]) -> list[_Table]:
    tables = []
    if "ape" in figures:
        ape = [(name[:-2], f"{100 * value:.2f} cm") for name, value in figures["ape"].items()]
        tables.append(("Absolute error (APE)", ape))
    if figures.get("rpe"):
        rpe = figures["rpe"]
        drift = [
            ("translation, rmse", f"{100 * rpe['trans_rmse_m']:.2f} cm"),
            ("rotation, rmse", f"{rpe['rot_rmse_deg']:.2f}°"),
        ]
        tables.append((f"Relative error over {rpe['delta_s']:g} s (RPE)", drift))
    return tables


def _tracking_table(figures: Mapping[str, Any]) -> _Table:
    counted = [(name, f"{figures[name]}") for name in ("frames", "tracked", "lost", "keyframes")]
    blind = figures["blind_restarts"]
    restarts = [("restarts at the last pose, not recognised", f"{blind}")] * bool(blind)
    frames = figures["unseen_motion"]
    unseen = [("frames that did not show all of the motion", f"{frames}")] * bool(frames)
    path = ("length of path", f"{figures['path_m']:.2f} m")
    return "Tracking", [*counted, *restarts, *unseen, path]


def _speed_table(figures: Mapping[str, Any]) -> _Table:
    latency = figures["latency_ms"]
    return (
        "Speed",
        [
            ("frames per second", f"{figures['fps']:.1f}"),
            *((f"latency, {name}", f"{value:.1f} ms") for name, value in latency.items()),
            ("memory, peak", f"{figures['peak_rss_mb']:.0f} MB"),
        ],
    )
