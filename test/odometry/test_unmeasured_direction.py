"""Where a frame measures nothing, its pose is the predicted one, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames, true_poses
from rigs.pose_problems import problem_of
from rigs.scenes import SCENES

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.pose_refinement import (
    COARSE_LEVELS,
    PoseEstimate,
    PoseProblem,
)
from rgbd_glue_ros.odometry.unmeasured_direction import without_spurious_motion
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.gauss_newton import evaluate_pose

CONFIG = Config()
EMPTY = SCENES["an empty corridor at 10 Hz"]
# the camera looks along the corridor
ALONG, ACROSS = 2, [0, 1]


def slid_in_corridor(
    seed: int, frame: int, predicted_along: float
) -> tuple[PoseProblem, PoseEstimate]:
    """A frame of the corridor on the one before, with a pose that slid along it."""
    before, now = [*EMPTY.noisy_frames(seed)][frame - 1 : frame + 1]
    T = se3.exp(np.array([0, 0, predicted_along, 0, 0, 0]))
    problem = problem_of(before, now, T, CONFIG)
    coarse = problem.refined(np.eye(4), COARSE_LEVELS)
    estimate = problem.refined_further(coarse, Acceptance.of(CONFIG.odometry))
    assert estimate.T_track_camera[ALONG, 3] < -0.3
    return problem, estimate


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_pose_that_slid_along_an_empty_corridor_is_put_back_without_moving_across(
    seed: int,
) -> None:
    problem, slid = slid_in_corridor(seed, frame=9, predicted_along=0.1)
    T_before, T_now = EMPTY.true_poses()[8:10]
    truth = se3.inverse(T_before) @ T_now
    found = without_spurious_motion(slid, problem).T_track_camera
    assert found[ALONG, 3] == pytest.approx(0.1, abs=0.01)
    assert np.linalg.norm((found - truth)[ACROSS, 3]) < 0.005


def test_a_predicted_pose_that_planes_contradict_is_not_taken() -> None:
    """Nothing that was seen before would be in view there."""
    problem, slid = slid_in_corridor(seed=0, frame=1, predicted_along=20.0)
    assert without_spurious_motion(slid, problem) is slid


def test_a_pose_is_judged_with_the_twist_that_it_was_refined_with() -> None:
    before, now = recorded_frames()[34:36]
    T_before, T_now = true_poses()[34:36]
    truth = se3.inverse(T_before) @ T_now
    problem = problem_of(before, now, truth, CONFIG)
    # predicted to turn fast, which would distort an image that is read row by row
    turning = np.array([0.0, 0.0, 0.0, 3.0, 0.0, 0.0])
    view = replace(problem.view, readout_time=0.03, twist=turning)
    # with a velocity that is known a little, other than at a start
    covariance = 0.9 * problem.predicted.covariance
    motion = replace(problem.predicted, twist=turning, covariance=covariance)
    problem = replace(problem, view=view, predicted=motion)
    coarse = problem.refined(truth, COARSE_LEVELS)
    estimate = problem.refined_further(coarse, Acceptance.of(CONFIG.odometry))
    agreeing, predicted = (
        evaluate_pose(estimate.T_track_camera, of).planes_agreeing
        for of in (problem.with_twist_used_for(estimate), problem)
    )
    assert agreeing == pytest.approx(estimate.refinement.planes_agreeing, rel=0.01)
    assert predicted < 0.9 * agreeing
