"""Depth that nothing can be done with is said in words that name the remedy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames, write_small_bag

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.replay.replay import replay
from rgbd_glue_ros.experiments.replay.result_names import METRICS, REPORT, TRAJECTORY
from rgbd_glue_ros.odometry.depth_diagnosis import (
    doubt_at_start,
    explain_no_pose,
    summarise_depth,
)
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import CameraConfig, InputConfig, load_preset
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.recordings.first_frames import first_frames
from rgbd_glue_ros.types import (
    DepthSummary,
    Float32,
    OdometryEstimate,
    RgbdFrame,
    TrackingState,
    Trajectory,
)

LIMITS = CameraConfig(depth_min=0.1, depth_max=8.0)
NAN = np.float32(np.nan)


def wall(metres: float, share: float = 1.0) -> Float32:
    """Some of the rows of an image at one depth, the rest unknown."""
    depth = np.full((100, 80), NAN)
    depth[: round(100 * share)] = metres
    return depth


def missing(depth: Float32) -> str:
    summary = summarise_depth(depth, LIMITS)
    return explain_no_pose(OdometryEstimate(1, TrackingState.INITIALIZING, depth=summary), LIMITS)


def test_fractions_and_median_are_those_of_the_image() -> None:
    depth = wall(2.0, 0.6)
    depth[:20] = 20.0
    assert summarise_depth(depth, LIMITS) == DepthSummary(0.6, 0.4, 2.0)
    depth[60:] = 0.0
    assert summarise_depth(depth, LIMITS) == DepthSummary(0.6, 0.4, 2.0)


@pytest.mark.parametrize(
    ("depth", "said"),
    [
        (wall(0.0, 0.0), "0% of the pixels have a depth: check that the topic"),
        (wall(1500.0), "the median is 1.5e+03 m, so these are millimetres: set depth_scale to"),
        (wall(15.0), "100% of the pixels have a depth, but 0% one from 0.1 to 8 m"),
        (wall(15.0), "the median is 15 m: if the unit is another, set depth_scale"),
        (wall(0.002), "the median is 0.002 m: if the unit is another"),
        (wall(2.0), "too little is visible to start"),
    ],
)
def test_a_frame_without_a_pose_gives_the_reason(depth: Float32, said: str) -> None:
    assert said in missing(depth)


@pytest.mark.parametrize(
    ("units", "is_doubtful"),
    [(0.1, True), (0.2, True), (1.0, False), (5.0, True), (10.0, True), (1000.0, False)],
)
def test_a_room_in_another_unit_makes_the_unit_doubtful_unless_it_is_told_later(
    units: float, is_doubtful: bool
) -> None:
    room = np.linspace(0.6, 3.0, 4000, dtype=np.float32).reshape(50, 80)
    assert (doubt_at_start(room * np.float32(units)) is not None) is is_doubtful


@pytest.mark.parametrize("is_known", [True, False])
def test_near_depth_is_doubtful_and_unknown_depth_is_not(is_known: bool) -> None:
    table = np.full((50, 80), 0.5 if is_known else np.nan, np.float32)
    assert (doubt_at_start(table) is not None) is is_known


def test_why_the_first_frames_have_no_pose_is_logged_once_for_each_cause(
    caplog: pytest.LogCaptureFixture,
) -> None:
    frames = recorded_frames()[:7]
    thousand = np.float32(1000)
    with Odometry() as odometry:
        for i, frame in enumerate(frames[:3]):
            millimetres = frame.depth * (thousand + i)
            assert odometry.process(replace(frame, depth=millimetres)).T_odom_camera is None
        odometry.reset()
        for frame in frames[3:5]:
            odometry.process(replace(frame, depth=np.full_like(frame.depth, np.nan)))
        for frame in frames[5:]:
            assert odometry.process(frame).T_odom_camera is not None
    millimetres_said, nothing_said = caplog.messages
    assert millimetres_said.startswith("No pose yet: ")
    assert "so these are millimetres" in millimetres_said
    assert "0% of the pixels have a depth" in nothing_said
    assert {record.levelname for record in caplog.records} == {"WARNING"}


class Frames:
    """A recording of these frames."""

    name = "sequence"
    ground_truth: Trajectory | None = None

    def __init__(self, frames: list[RgbdFrame]) -> None:
        self.frames = frames
        self.frame_count = len(frames)

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter(self.frames)


@pytest.mark.parametrize(
    ("factor", "said"), [(0.0, "0% of the pixels"), (1000.0, "so these are millimetres")]
)
def test_a_replay_that_tracks_nothing_is_an_error_and_leaves_its_results(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, factor: float, said: str
) -> None:
    frames = [
        replace(f, depth=np.where(factor > 0, f.depth * np.float32(factor), NAN))
        for f in recorded_frames()[:3]
    ]
    with pytest.raises(InputError, match=r"^sequence: none of its 3 frames was tracked: ") as error:
        replay(Frames(frames), load_preset("live"), tmp_path)  # type: ignore[arg-type]
    assert said in str(error.value)
    assert (tmp_path / METRICS).is_file()
    assert (tmp_path / TRAJECTORY).is_file()
    # in one line, which the report has too
    assert not caplog.messages
    report = (tmp_path / REPORT).read_text(encoding="utf-8")
    box = report.partition('<div class="notes">')[2].partition("</div>")[0]
    assert "<li>No frame was tracked: " in box
    assert said in box


def test_of_a_bag_the_topic_of_useless_depth_is_named(tmp_path: Path) -> None:
    bag = write_small_bag(tmp_path / "bag", 2)
    given = InputConfig(depth_scale=1000.0)
    topic = "/camera/aligned_depth_to_color/image_raw"
    why = rf"none of its 2 frames was tracked: .*; the median on {topic} is "
    with (
        open_recording(bag, inputs=given) as recording,
        pytest.raises(InputError, match=why),
    ):
        replay(first_frames(recording, 2), load_preset("live"), tmp_path / "out")


def test_a_replay_says_that_the_unit_of_depth_is_doubtful(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frames = [replace(f, depth=f.depth / np.float32(10)) for f in recorded_frames()[:2]]
    replay(Frames(frames), load_preset("live"), tmp_path)  # type: ignore[arg-type]
    assert "sequence: the median depth is 0." in caplog.text
    assert "set depth_scale" in caplog.text
