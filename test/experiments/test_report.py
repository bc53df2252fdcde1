"""The report is one page that needs nothing else, whatever the run was like."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rigs.pages import Page

from rgbd_glue_ros.evaluation.run_record import FrameRecord, Run, metrics
from rgbd_glue_ros.experiments.replay.report import render
from rgbd_glue_ros.parameters import Config, with_values
from rgbd_glue_ros.types import TrackingState


def page_of(run: Run) -> str:
    return render(run, metrics(run, None), None)


def record(i: int, state: TrackingState = TrackingState.TRACKING) -> FrameRecord:
    T = np.eye(4)
    T[:3, 3] = np.sin(i / 1000), 0, np.cos(i / 777)
    pose = T if state is TrackingState.TRACKING else None
    return FrameRecord(i * 33_333_333, state, pose, 20.0 + i % 7, stages_ms={"total": 20.0})


def test_the_report_is_one_well_formed_page_that_fetches_nothing() -> None:
    states = [TrackingState.INITIALIZING, TrackingState.TRACKING, TrackingState.LOST] * 3
    frames = [record(i, state) for i, state in enumerate(states)]
    run = Run("a <script> & more", Config(), frames=frames, wall_s=1.0)
    source = page_of(run)
    page = Page(source)
    assert page.open == []
    assert "a <script> & more" in page.text
    assert page.fetched == []
    assert "://" not in source
    assert "url(" not in source


def test_the_report_names_the_parameters_that_differ_from_the_defaults() -> None:
    config = with_values(Config(), {"glue.k": 3.0})
    text = " ".join(Page(page_of(Run("x", config, frames=[record(0)], wall_s=1.0))).text)
    assert "glue.k" in text
    assert "ransac.iterations" not in text


@pytest.mark.parametrize("state", TrackingState)
def test_a_single_frame_of_any_state_has_a_report(state: TrackingState) -> None:
    assert Page(page_of(Run("x", Config(), frames=[record(0, state)], wall_s=1.0))).open == []


def test_the_report_of_an_hour_is_smaller_than_five_megabytes() -> None:
    frames = [record(i) for i in range(3600 * 30)]
    assert len(page_of(Run("hour", Config(), frames=frames, wall_s=1.0))) < 5_000_000


@pytest.mark.parametrize(
    ("known", "title"),
    [
        ({"visual_inliers": 80}, "Visual inliers"),
        ({"credible": 300}, "Credible geometric matches"),
        ({"stages_ms": {"ransac": 0.3}}, "Where the time goes"),
    ],
)
def test_what_no_frame_tells_has_no_chart(known: dict[str, Any], title: str) -> None:
    """The demonstration sees the poses of a node, and nothing of how they came about."""
    untold = replace(record(1), stages_ms={})
    for frame, shown in ((untold, False), (replace(untold, **known), True)):
        text = " ".join(Page(page_of(Run("x", Config(), frames=[frame], wall_s=1.0))).text)
        assert (title in text) == shown
