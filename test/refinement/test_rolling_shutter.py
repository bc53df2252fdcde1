"""The velocity that one frame shows by its distortion, where it has any."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.room import CAMERA, rolling_frame, true_pose, true_twist

from rgbd_glue_ros.geometry import se3, views
from rgbd_glue_ros.parameters import RefineConfig
from rgbd_glue_ros.refinement.gauss_newton import refine
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.rolling_shutter import distortion_at, twist_from_distortion
from rgbd_glue_ros.types import Float64, View

REFINE = RefineConfig(iterations=15, residuals_per_independent_one=1.0)
# the camera moves at half a metre and 20 degrees a second, in different directions
TIMES = 1.0, 1.3
LEVEL = 0


def view(time_s: float, readout_time: float, latency: float, twist: Float64) -> View:
    frame = rolling_frame(time_s, readout_time, latency)
    return View(views.grey(frame.color), frame.depth, CAMERA, twist, readout_time, -latency)


def seen(
    readout_time: float, latency: float, start: Float64, config: RefineConfig = REFINE
) -> tuple[Float64, Float64]:
    """The velocity that the second frame shows, searched for from ``start``."""
    model = model_of(view(TIMES[0], readout_time, latency, true_twist(TIMES[0])), 8)
    T = se3.inverse(true_pose(TIMES[0])) @ true_pose(TIMES[1])
    velocity, covariance = start, np.eye(6)
    for _ in range(3):
        source = view(TIMES[1], readout_time, latency, velocity)
        problem = RefinementProblem(model, source, config)
        found = refine(T, problem, [LEVEL])
        T = found.T_model_source
        measured, _ = twist_from_distortion(found, problem, LEVEL)
        velocity, covariance = measured.twist, measured.covariance
    return velocity, covariance


@pytest.mark.slow
@pytest.mark.parametrize(("readout_time", "latency"), [(0.03, 0.0), (0.026, 0.017), (-0.03, 0.0)])
def test_a_rolling_shutter_reveals_the_velocity(readout_time: float, latency: float) -> None:
    truth = true_twist(TIMES[1])
    assert np.linalg.norm(truth) > 0.3
    velocity, _ = seen(readout_time, latency, np.zeros(6))
    # the picture is rendered in bands of a few rows, at a resolution of 320 x 240
    assert np.linalg.norm(velocity - truth) < 0.4 * np.linalg.norm(truth)


@pytest.mark.slow
def test_a_global_shutter_reveals_nothing_and_leaves_the_velocity_unchanged() -> None:
    start = np.array([0.1, -0.2, 0.3, 0.1, 0.2, -0.3])
    velocity, covariance = seen(0.0, 0.0, start)
    np.testing.assert_array_equal(velocity, start)
    assert (np.diag(covariance) > 1e3).all()


@pytest.mark.slow
def test_a_slower_shutter_reveals_the_twist_more_precisely() -> None:
    slow, fast = (
        np.diag(seen(readout_time, 0.0, true_twist(TIMES[1]))[1]) for readout_time in (0.03, 0.015)
    )
    np.testing.assert_array_less(slow, fast)


@pytest.mark.slow
def test_correlated_residuals_make_the_velocity_less_certain() -> None:
    start = true_twist(TIMES[1])
    sure, unsure = (
        np.diag(seen(0.03, 0.0, start, replace(REFINE, residuals_per_independent_one=c))[1])
        for c in (1.0, 100.0)
    )
    np.testing.assert_allclose(unsure, 100 * sure, rtol=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(("readout_time", "latency"), [(0.03, 0.0), (0.026, 0.017), (0.0, 0.033)])
def test_the_pose_depends_on_the_velocity_as_refinements_with_two_of_them_do(
    readout_time: float, latency: float
) -> None:
    model = model_of(view(TIMES[0], readout_time, latency, true_twist(TIMES[0])), 8)
    T, truth = se3.inverse(true_pose(TIMES[0])) @ true_pose(TIMES[1]), true_twist(TIMES[1])
    for error in 0.1 * np.eye(6):
        poses = []
        for twist in (truth - error, truth + error):
            source = view(TIMES[1], readout_time, latency, twist)
            problem = RefinementProblem(model, source, REFINE)
            poses.append(refine(T, problem, [LEVEL]).T_model_source)
        problem = replace(problem, view=replace(source, twist=truth))
        distortion = distortion_at(refine(T, problem, [LEVEL]), problem, LEVEL)
        np.testing.assert_array_equal(distortion.twist, truth)
        change = se3.log(se3.inverse(poses[0]) @ poses[1])
        expected = -distortion.seconds @ (2 * error)
        assert np.linalg.norm(change - expected) < 0.4 * np.linalg.norm(change)
