"""Puts a pose where it was expected in directions in which its frame measured nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.odometry.pose_choice import CLEARLY_BETTER
from rgbd_glue_ros.odometry.pose_refinement import FINAL_LEVEL, PoseEstimate, PoseProblem
from rgbd_glue_ros.refinement.gauss_newton import evaluate_pose
from rgbd_glue_ros.refinement.reliability import (
    ExpectedPose,
    expected_where_unmeasured,
    without_spurious_information,
)


def without_spurious_motion(estimate: PoseEstimate, problem: PoseProblem) -> PoseEstimate:
    """The estimate without spurious information, as predicted where nothing was measured.

    Which information is spurious is found at the pose. If planes clearly contradict the predicted
    one farther away, these directions were measured, and the estimate is returned unchanged.

    Args:
        estimate: as refined.
        problem: the inputs of its refinement.
    """
    refined, predicted = estimate.refinement, problem.predicted
    tolerance = problem.basin.translation
    expected = ExpectedPose(predicted.T_track_camera, predicted.pose_covariance)
    corrected = without_spurious_information(
        refined, expected, problem.with_twist_used_for(estimate), tolerance
    )
    if np.array_equal(corrected.T_model_source, refined.T_model_source):
        return replace(estimate, refinement=corrected)
    # Directions are known to a few degrees only: going back along them also led across them.
    again = problem.refined(corrected.T_model_source, [FINAL_LEVEL])
    put_back = expected_where_unmeasured(again, expected, problem, tolerance)
    evaluated = evaluate_pose(put_back.T_model_source, problem)
    if refined.plane_agreement > evaluated.plane_agreement + CLEARLY_BETTER:
        return estimate
    return replace(estimate, refinement=replace(evaluated, information=put_back.information))
