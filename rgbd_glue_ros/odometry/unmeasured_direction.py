"""Puts a pose where it was expected in a direction in which its frame measured nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.odometry.pose_choice import CLEARLY_BETTER
from rgbd_glue_ros.odometry.pose_refinement import FINAL_LEVEL, PoseEstimate, PoseProblem
from rgbd_glue_ros.refinement.gauss_newton import evaluate_pose
from rgbd_glue_ros.refinement.reliability import (
    ExpectedPose,
    expected_where_weakest,
    without_spurious_information,
)


def expected_where_unmeasured(estimate: PoseEstimate, problem: PoseProblem) -> PoseEstimate:
    """The estimate without spurious information, as predicted where nothing was measured.

    Which information is spurious is found from residuals nearby. If planes clearly contradict the
    predicted pose farther away, the direction was measured, and the estimate is returned unchanged.

    Args:
        estimate: as refined.
        problem: the inputs of its refinement.
    """
    refined, as_refined = estimate.refinement, problem.as_refined(estimate)
    predicted, reach = problem.predicted, problem.basin.translation
    expected = ExpectedPose(predicted.T_track_camera, predicted.pose_covariance)
    found = without_spurious_information(refined, expected, as_refined, reach)
    if np.array_equal(found.T_model_source, refined.T_model_source):
        return replace(estimate, refinement=found)
    # The direction is known to a few degrees only: the way along it also led across it.
    again = problem.refined(found.T_model_source, [FINAL_LEVEL])
    found = expected_where_weakest(again, expected, reach)
    there = evaluate_pose(found.T_model_source, problem)
    if refined.plane_agreement > there.plane_agreement + CLEARLY_BETTER:
        return estimate
    return replace(estimate, refinement=replace(there, information=found.information))
