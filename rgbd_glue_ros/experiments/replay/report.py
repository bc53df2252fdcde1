"""The report of a run: one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from typing import Any

import numpy as np

from rgbd_glue_ros.evaluation.run_record import FrameRecord, Run
from rgbd_glue_ros.evaluation.trajectory import MAX_TIME_DIFFERENCE_S
from rgbd_glue_ros.evaluation.trajectory_errors import RPE_DELTA_S, Evaluation
from rgbd_glue_ros.experiments.report import charts
from rgbd_glue_ros.experiments.report.charts import Line, Span
from rgbd_glue_ros.experiments.report.page import SIDE_BY_SIDE, changed_parameters, page, tiles
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import NANOSECONDS, Float64, Int64, TrackingState

_STATES = {
    TrackingState.TRACKING: ("tracking", "var(--good)"),
    TrackingState.INITIALIZING: ("initializing", "var(--wait)"),
    TrackingState.LOST: ("lost", "var(--bad)"),
}
_TALL, _LOW = 5, 3


def render(run: Run, figures: Mapping[str, Any], evaluation: Evaluation | None) -> str:
    """The page.

    Args:
        run: with one frame at least.
        figures: its ``metrics``.
        evaluation: of its trajectory; None without ground truth.
    """
    seconds = _seconds(run, np.array([frame.stamp_ns for frame in run.frames], np.int64))
    parts = [
        _summary(run, seconds),
        _tiles(figures),
        _trajectory(run, evaluation),
        "<h2>Over time</h2>",
        _states(run.frames, seconds),
        *_charts(run, seconds, evaluation),
        *_stages(figures["stages_ms"]),
        "<h2>All figures</h2>",
        _figures(figures),
        "<h2>Parameters that differ from the defaults</h2>",
        changed_parameters(run.config),
    ]
    return page(run.sequence, parts)


def _summary(run: Run, seconds: Float64) -> str:
    return (
        f"<p>{len(run.frames)} frames, {seconds[-1]:.1f} s of recording, "
        f"replayed in {run.wall_s:.1f} s by rgbd-glue.</p>"
    )


def _seconds(run: Run, stamps_ns: Int64) -> Float64:
    """Time since the first frame."""
    return np.asarray((stamps_ns - run.frames[0].stamp_ns) / NANOSECONDS, np.float64)


def _tiles(figures: Mapping[str, Any]) -> str:
    tracked = f"{100 * figures['tracked'] / figures['frames']:.4g}"
    shown = []
    if "ape" in figures:
        shown.append((f"{100 * figures['ape']['rmse_m']:.2f}", "cm", "position error, rmse (APE)"))
    if figures.get("rpe"):
        rpe = figures["rpe"]
        shown.append((f"{100 * rpe['trans_rmse_m']:.2f}", "cm/s", "drift, rmse (RPE)"))
        shown.append((f"{rpe['rot_rmse_deg']:.2f}", "°/s", "rotation drift, rmse (RPE)"))
    shown += [
        (tracked, "%", f"of frames tracked, {figures['lost']} lost"),
        (f"{figures['latency_ms']['p50']:.1f}", "ms", "median latency of a frame"),
        (f"{figures['fps']:.1f}", "fps", "whole replay, decoding included"),
    ]
    return tiles(shown)


def _trajectory(run: Run, evaluation: Evaluation | None) -> str:
    poses = run.trajectory.poses
    if not len(poses):
        return "<h2>Trajectory</h2><p>No frame has a pose.</p>"
    tracks = []
    if evaluation is not None:
        # the truth, laid upon the estimate, so that the picture has the first camera's axes
        truth = se3.inverse(evaluation.T_reference_estimate) @ evaluation.reference
        tracks.append(("ground truth", "var(--truth)", truth[:, :3, 3], "thick"))
    tracks.append(("estimate", "var(--estimate)", poses[:, :3, 3], ""))
    above = [Line(name, color, p[:, 0], p[:, 2], style) for name, color, p, style in tracks]
    beside = [Line(name, color, p[:, 2], -p[:, 1], style) for name, color, p, style in tracks]
    aligned = "; the ground truth is laid upon it by rotation and translation"
    return (
        "<h2>Trajectory</h2><p>In the axes of the first camera, from the green to the red end"
        f"{aligned if evaluation else ''}.</p>"
        f'<div class="two">{charts.plan("From above (right, forward)", above)}'
        f"{charts.plan('From the side (forward, up)', beside)}</div>"
    )


def _states(frames: list[FrameRecord], seconds: Float64) -> str:
    # a frame's state holds until the next frame
    edges = np.append(seconds, seconds[-1]) / (seconds[-1] or 1.0)
    spans, start = [], 0
    for state, group in groupby(frames, key=lambda frame: frame.state):
        stop = start + len(list(group))
        spans.append(Span(edges[start], edges[stop], _STATES[state][1]))
        start = stop
    keyframes = edges[[i for i, frame in enumerate(frames) if frame.is_keyframe]]
    present = {frame.state for frame in frames}
    keys = [key for state, key in _STATES.items() if state in present]
    title = f"State, and a tick for each of {len(keyframes)} keyframes"
    return charts.band(title, keys, spans, keyframes)


def _charts(run: Run, seconds: Float64, evaluation: Evaluation | None) -> list[str]:
    span = (float(seconds.min()), float(seconds.max()))
    drawn = []
    if evaluation is not None:
        x, y = _seconds(run, evaluation.stamps_ns), 100 * evaluation.errors_m
        rmse = Line(
            "rmse", "var(--quiet)", x, np.full(len(x), 100 * evaluation.ape.rmse_m), "dashed"
        )
        error = Line("of each pose", "var(--estimate)", x, y)
        drawn.append(charts.chart("Position error after alignment, cm", [rmse, error], span, _TALL))
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
            drawn.append(charts.chart(title, [Line(title, color, seconds, y)], span, _LOW))
    drawn.append(_latency(run.frames, seconds, span))
    return drawn


def _latency(frames: list[FrameRecord], seconds: Float64, span: tuple[float, float]) -> str:
    latency = np.array([frame.latency_ms for frame in frames])
    interval = 1000 * float(np.median(np.diff(seconds))) if len(seconds) > 1 else float("nan")
    # the first frames may compile code: their seconds would hide all others
    ceiling = 3 * float(np.nanmax([interval, np.percentile(latency, 95)]))
    lines = [
        Line("between frames", "var(--quiet)", seconds, np.full(len(seconds), interval), "dashed"),
        Line("per frame", "var(--estimate)", seconds, np.minimum(latency, ceiling)),
    ]
    return charts.chart("Latency, ms", lines, span, _TALL)


def _stages(medians: Mapping[str, float]) -> list[str]:
    """The section about stages; none where they were not timed, as in a node."""
    if not medians:
        return []
    named = {name.replace("_", " "): value for name, value in medians.items()}
    return [
        "<h2>Where the time goes</h2>",
        f"<p>Median of each stage. {SIDE_BY_SIDE}</p>",
        charts.bars(named, "ms", "var(--estimate)"),
    ]


def _figures(figures: Mapping[str, Any]) -> str:
    latency = figures["latency_ms"]
    tables = [
        (
            "Tracking",
            [
                ("frames", f"{figures['frames']}"),
                ("tracked", f"{figures['tracked']}"),
                ("lost", f"{figures['lost']}"),
                ("keyframes", f"{figures['keyframes']}"),
                ("length of path", f"{figures['path_m']:.2f} m"),
            ],
        ),
        (
            "Speed",
            [
                ("frames per second", f"{figures['fps']:.1f}"),
                *((f"latency, {name}", f"{value:.1f} ms") for name, value in latency.items()),
                ("memory, peak", f"{figures['peak_rss_mb']:.0f} MB"),
            ],
        ),
    ]
    note = ""
    if "ape" in figures:
        ape = [(name[:-2], f"{100 * value:.2f} cm") for name, value in figures["ape"].items()]
        tables.insert(0, ("Absolute error (APE)", ape))
        note = (
            "<p>APE: distance of positions after alignment by rotation and translation (no "
            f"scale), poses nearest in time, one-to-one, within {MAX_TIME_DIFFERENCE_S:g} s. "
            f"RPE: error of the motion over every pair of poses {RPE_DELTA_S:g} s apart.</p>"
        )
    if figures.get("rpe"):
        rpe = figures["rpe"]
        drift = [
            ("translation, rmse", f"{100 * rpe['trans_rmse_m']:.2f} cm"),
            ("rotation, rmse", f"{rpe['rot_rmse_deg']:.2f}°"),
        ]
        tables.insert(1, (f"Relative error over {rpe['delta_s']:g} s (RPE)", drift))
    body = "".join(
        f"<table><caption>{title}</caption>"
        + "".join(f'<tr><td>{name}</td><td class="n">{value}</td></tr>' for name, value in rows)
        + "</table>"
        for title, rows in tables
    )
    return f'{note}<div class="two">{body}</div>'
