"""The report is one page that needs nothing else, whatever the run was like."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from rigs.pages import Page
from rigs.pan import Pan

from rgbd_glue_ros.evaluation.trajectory_errors import evaluate
from rgbd_glue_ros.experiments.replay.moments import worst
from rgbd_glue_ros.experiments.replay.report import render
from rgbd_glue_ros.experiments.replay.run_record import FrameRecord, Run, metrics
from rgbd_glue_ros.experiments.replay.series import errors_since_start, with_gaps
from rgbd_glue_ros.experiments.replay.thumbnails import WIDTH, Thumbnails, thumbnail
from rgbd_glue_ros.experiments.report.colophon import Colophon
from rgbd_glue_ros.parameters import Config, with_values
from rgbd_glue_ros.types import OdometryEstimate, TrackingState, Trajectory


def page_of(run: Run) -> str:
    colophon = Colophon("1.2.3", "2026-01-02 03:04 UTC", "4 cores", run.command, run.sequence)
    return render(run, metrics(run, None), None, colophon)


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


@pytest.mark.parametrize(("tracked", "share"), [(1, "3.3"), (29, "96.6"), (30, "100"), (0, "0")])
def test_the_share_of_tracked_frames_has_one_decimal_and_is_100_only_of_all(
    tracked: int, share: str
) -> None:
    states = [TrackingState.TRACKING] * tracked + [TrackingState.LOST] * (30 - tracked)
    frames = [record(i, state) for i, state in enumerate(states)]
    assert f"<b>{share} <small>%</small>" in page_of(Run("x", Config(), frames=frames, wall_s=1.0))


def test_one_keyframe_is_told_of_in_the_singular() -> None:
    frames = [replace(record(i), is_keyframe=i == 0) for i in range(3)]
    text = " ".join(Page(page_of(Run("x", Config(), frames=frames, wall_s=1.0))).text)
    assert "State, and a tick for the keyframe" in text


def test_warnings_are_in_a_box_above_everything_else() -> None:
    run = Run("x", Config(), frames=[record(0)], wall_s=1.0, warnings=["depth <in> mm", "late"])
    source = page_of(run)
    assert source.index("<li>depth &lt;in&gt; mm</li><li>late</li>") < source.index("of recording")
    run.warnings.clear()
    assert 'class="notes"' not in page_of(run)


def test_the_report_names_the_parameters_that_differ_from_the_defaults() -> None:
    config = with_values(Config(), {"glue.k": 3.0})
    text = " ".join(Page(page_of(Run("x", config, frames=[record(0)], wall_s=1.0))).text)
    assert "glue.k" in text
    assert "ransac.iterations" not in text


@pytest.mark.parametrize("state", TrackingState)
def test_a_single_frame_of_any_state_has_a_report(state: TrackingState) -> None:
    assert Page(page_of(Run("x", Config(), frames=[record(0, state)], wall_s=1.0))).open == []


@pytest.mark.slow
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


PERIOD_NS = 33_333_333


def shown(run: Run) -> str:
    return " ".join(Page(page_of(run)).text)


def test_frames_that_a_node_dropped_are_said_and_break_the_lines() -> None:
    frames = [record(i) for i in range(0, 20, 2)]
    run = Run("x", Config(), frames=frames, wall_s=1.0)
    assert "10 frames, " in shown(run)
    run.unanswered_ns = tuple(i * PERIOD_NS for i in range(1, 19, 2))
    assert "10 of 19 frames processed" in shown(run)
    assert "dropped, or without a pose" in shown(run)
    stamps = np.array([frame.stamp_ns for frame in frames])
    seconds, values = with_gaps(run, stamps, np.ones(10))
    np.testing.assert_array_equal(np.isnan(values), np.arange(19) % 2 == 1)
    np.testing.assert_allclose(seconds, np.arange(19) * PERIOD_NS / 1e9)


def test_lines_break_where_a_recording_has_a_gap() -> None:
    stamps = np.array([0, 1, 2, 3, 9, 10]) * PERIOD_NS
    run = Run("x", Config(), frames=[record(i) for i in (0, 1, 2, 3, 9, 10)], wall_s=1.0)
    _, values = with_gaps(run, stamps, np.ones(6))
    assert np.isnan(values).tolist() == [False] * 4 + [True] + [False] * 2


def test_a_frame_far_slower_than_others_leaves_them_readable_and_is_said() -> None:
    frames = [record(i) for i in range(60)]
    frames[0] = replace(frames[0], latency_ms=9000.0)
    source = page_of(Run("x", Config(), frames=frames, wall_s=1.0))
    assert 'data-range="0,50"' in source
    assert "up to 9000 ms (at 0.0 s)" in source


def test_the_worst_moments_are_found_by_state_matches_and_time() -> None:
    frames = [replace(record(i), latency_ms=20.0, visual_inliers=90) for i in range(10)]
    frames[3] = replace(frames[3], visual_inliers=7)
    frames[5] = record(5, TrackingState.LOST)
    frames[6] = record(6, TrackingState.LOST)
    frames[8] = replace(frames[8], latency_ms=70.0)
    found = {moment.said: round(moment.stamp_ns / PERIOD_NS) for moment in worst(frames, None)}
    assert found == {"lost": 5, "fewest visual inliers, 7": 3, "slowest, 70 ms": 8}


def test_keyframes_and_worst_moments_are_shown_as_pictures_in_the_page() -> None:
    frames = [replace(record(i), is_keyframe=i % 3 == 0, visual_inliers=50 + i) for i in range(9)]
    run = Run("x", Config(), frames=frames, wall_s=1.0)
    run.thumbnails = {f.stamp_ns: thumbnail(np.zeros((48, 64), np.uint8)) for f in frames}
    page = Page(page_of(run))
    assert page.open == []
    assert len(page.fetched) == 3 + 2
    assert all(str(source).startswith("data:image/jpeg;base64,") for source in page.fetched)


def test_pictures_are_few_and_spread_over_a_replay_of_any_length() -> None:
    kept = Thumbnails()
    frame = next(iter(Pan(1)))
    for i in range(1000):
        kept.add(frame, OdometryEstimate(i, TrackingState.TRACKING))
    assert 200 <= len(kept.jpegs) <= 400
    assert np.ptp(np.diff(list(kept.jpegs))) == 0
    image = cv2.imdecode(np.frombuffer(kept.jpegs[0], np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape[1] == WIDTH


def test_errors_since_the_start_are_those_of_the_first_camera_whatever_the_worlds_axes() -> None:
    truth = Pan(10).ground_truth
    off = truth.poses.copy()
    off[:, 2, 3] += 0.01 * np.arange(10)
    start = np.linalg.inv(off[0])
    evaluation = evaluate(Trajectory(truth.stamps_ns, start @ off), truth)
    position, angle = errors_since_start(evaluation)
    axis = start[:3, :3] @ [0, 0, 1]
    np.testing.assert_allclose(position, 0.01 * np.arange(10)[:, None] * axis, atol=1e-9)
    np.testing.assert_allclose(angle, 0, atol=1e-6)


def test_the_page_ends_with_what_made_it() -> None:
    run = Run("x", Config(), frames=[record(0)], wall_s=1.0, command="rgbd-glue replay 'a b'")
    text = shown(run)
    for part in ("1.2.3", "2026-01-02 03:04 UTC", "4 cores", "rgbd-glue replay 'a b'"):
        assert part in text
