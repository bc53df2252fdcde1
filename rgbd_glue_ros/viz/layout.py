"""The layout of the viewer when a recording is opened, and the names in it."""

from __future__ import annotations

from typing import Any

ELAPSED, STAMP = "elapsed", "stamp"
"""Timelines: since the first frame, and the stamps of the images."""

ODOM = "odom"
"""The odom frame with the camera's axes, in the fixed frame, whose z axis is up."""

CAMERA, DEPTH_CAMERA = f"{ODOM}/camera", f"{ODOM}/depth_camera"
COLOR, DEPTH = f"{CAMERA}/color", f"{DEPTH_CAMERA}/depth"
MATCHES = f"{CAMERA}/matches"
COVARIANCE = f"{ODOM}/covariance"
KEYFRAMES = f"{ODOM}/keyframes"
TRAJECTORY, TRUTH = f"{ODOM}/trajectory", f"{ODOM}/truth"
CORRECTED, LOOPS = f"{ODOM}/corrected", f"{ODOM}/loops"
STATE = "state"
EPSILON, COUNTS, LATENCY = "plots/epsilon", "plots/matches", "plots/latency"


def blueprint(rerun: Any) -> Any:
    """The layout: a large scene, beside it the images and the plots."""
    views = rerun.blueprint
    # a trajectory is logged piece by piece, and should be visible up to the current time
    so_far = views.VisibleTimeRanges(
        [
            views.VisibleTimeRange(
                name,
                start=views.TimeRangeBoundary.infinite(),
                end=views.TimeRangeBoundary.cursor_relative(),
            )
            for name in (ELAPSED, STAMP)
        ]
    )
    scene = views.Spatial3DView(
        origin="/",
        contents=["/**", "- /plots/**", f"- /{COLOR}", f"- /{MATCHES}/**"],
        name="Scene",
        overrides={TRAJECTORY: so_far},
    )
    images = views.Tabs(
        views.Spatial2DView(
            origin=CAMERA,
            contents=[f"/{COLOR}", f"/{MATCHES}/**"],
            name="Matches",
        ),
        views.Spatial2DView(origin=DEPTH_CAMERA, contents=[f"/{DEPTH}"], name="Depth"),
        name="Images",
    )
    hidden = views.PlotLegend(visible=False)
    legend = views.PlotLegend(corner=views.Corner2D.LeftTop)
    plots = [
        views.TimeSeriesView(origin=EPSILON, name="Epsilon, cm", plot_legend=hidden),
        views.TimeSeriesView(origin=COUNTS, name="Matches", plot_legend=legend),
        views.Tabs(
            views.TimeSeriesView(origin=LATENCY, name="Time per frame, ms", plot_legend=hidden),
            views.TextLogView(origin=STATE, name="State"),
            name="More",
        ),
    ]
    return views.Blueprint(
        views.Horizontal(
            scene,
            views.Vertical(images, *plots, row_shares=[4, 2, 2, 2]),
            column_shares=[3, 2],
        ),
        views.TimePanel(timeline=ELAPSED, state="collapsed"),
        views.SelectionPanel(state="collapsed"),
        views.BlueprintPanel(state="collapsed"),
    )
