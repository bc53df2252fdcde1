"""The timing of a camera is found in its images, and nowhere else where it does not show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.room import CAMERA, rolling_frame, room_view, true_pose, true_twist

from rgbd_glue_ros.geometry import se3, views
from rgbd_glue_ros.parameters import RefineConfig, TimeOffsetsConfig
from rgbd_glue_ros.refinement.gauss_newton import Refinement, refine
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.refinement.pose_residuals import rows_at
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.time_offsets import TimeOffsets
from rgbd_glue_ros.types import Float64, RgbdFrame, View

STEP = 8
REFINE = RefineConfig(iterations=15)
# two frames without noise tell as much as they can
SURE = TimeOffsetsConfig(residuals_per_independent_one=1.0)
# the camera moves at half a metre and 20 degrees a second, in different directions
TIMES = 1.0, 1.3


def prepared(frame: RgbdFrame, time_s: float, timing: TimeOffsets) -> View:
    """The frame as odometry sees it that knows its velocity, and its timing more or less."""
    grey, twist = views.grey(frame.color), true_twist(time_s)
    return View(grey, frame.depth, CAMERA, twist, timing.readout_time, -timing.depth_latency)


def corrected(
    timing: TimeOffsets, found: Refinement, problem: RefinementProblem, config: TimeOffsetsConfig
) -> TimeOffsets:
    """The timing after a frame with a pose."""
    rows = rows_at(found, problem, level=0)
    return timing.corrected(rows, found.T_model_source, problem, config)


def found_in(
    frames: list[RgbdFrame], timing: TimeOffsets, config: TimeOffsetsConfig
) -> tuple[TimeOffsets, Float64]:
    """The timing after two frames, and T_model_source."""
    target, source = (prepared(f, t, timing) for f, t in zip(frames, TIMES, strict=True))
    problem = RefinementProblem(model_of(target, STEP), source, REFINE)
    start = se3.inverse(true_pose(TIMES[0])) @ true_pose(TIMES[1])
    found = refine(start, problem)
    return corrected(timing, found, problem, config), found.T_model_source


def pose_error(T: Float64) -> tuple[float, float]:
    error = se3.inverse(se3.inverse(true_pose(TIMES[0])) @ true_pose(TIMES[1])) @ T
    return float(np.linalg.norm(error[:3, 3])), se3.rotation_angle(error)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("latency", "readout_time"),
    [(0.0, 0.0), (0.02, 0.0), (0.0, 0.03), (0.015, 0.026), (-0.01, -0.02)],
)
def test_latency_and_readout_time_are_recovered_and_make_the_pose_right(
    latency: float, readout_time: float
) -> None:
    frames = [rolling_frame(t, readout_time, latency) for t in TIMES]
    first_guess = timing = TimeOffsets.start(SURE, "")
    _, T_ignorant = found_in(frames, timing, SURE)
    for _ in range(5):
        timing, T = found_in(frames, replace(timing, covariance=first_guess.covariance), SURE)
    assert timing.depth_latency == pytest.approx(latency, abs=0.002)
    assert timing.readout_time == pytest.approx(readout_time, abs=0.001)
    assert pose_error(T)[0] < 0.003
    if readout_time:
        assert pose_error(T)[0] < 0.3 * pose_error(T_ignorant)[0]


def test_a_camera_at_rest_does_not_reveal_its_timing() -> None:
    view = room_view(TIMES[0])
    problem = RefinementProblem(model_of(view, STEP), view, REFINE)
    found = refine(np.eye(4), problem)
    start = TimeOffsets.start(TimeOffsetsConfig(drift=0.0), "")
    timing = corrected(start, found, problem, TimeOffsetsConfig(drift=0.0))
    assert (timing.depth_latency, timing.readout_time) == (0.0, 0.0)
    np.testing.assert_allclose(timing.covariance, start.covariance)


def test_the_timing_of_cameras_known_by_their_frame_is_settled() -> None:
    timing = TimeOffsets.start(TimeOffsetsConfig(), "openni_rgb_optical_frame")
    assert timing.is_settled
    assert timing.depth_latency > 0
    assert timing.readout_time > 0
    assert not TimeOffsets.start(TimeOffsetsConfig(), "camera_color_optical_frame").is_settled


def test_a_user_calibration_is_kept_for_any_camera() -> None:
    own = TimeOffsetsConfig(depth_latency=0.004, readout_time=0.01, spread=0.0)
    for frame_id in ("openni_rgb_optical_frame", "camera_color_optical_frame"):
        timing = TimeOffsets.start(own, frame_id)
        assert timing.is_settled
        assert (timing.depth_latency, timing.readout_time) == (0.004, 0.01)


def test_a_frame_without_finite_results_leaves_the_timing_unchanged() -> None:
    timing = TimeOffsets.start(SURE, "")
    view = prepared(rolling_frame(TIMES[0], 0.0, 0.0), TIMES[0], timing)
    problem = RefinementProblem(model_of(view, STEP), view, REFINE)
    found = refine(np.eye(4), problem)
    poisoned = replace(found, affine_brightness=np.full(3, np.nan))
    assert corrected(timing, found, problem, SURE) is not timing
    assert corrected(timing, poisoned, problem, SURE) is timing


def test_the_readout_ratio_is_the_longest_plausible_time_relative_to_a_kinect() -> None:
    kinect = TimeOffsets.start(TimeOffsetsConfig(), "openni_rgb_optical_frame")
    assert kinect.readout_ratio == 1.0
    assert TimeOffsets(0.0, 0.0, np.zeros((2, 2))).readout_ratio == 0.0
    # read from below, and not yet known to 5 ms
    backwards = TimeOffsets(0.0, -0.021, np.diag([0.0, 0.005**2]))
    assert backwards.readout_ratio == pytest.approx(1.0)
