"""The poses of a frame that refinement from different starts leads to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import distances
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.image_turn import turn_between
from rgbd_glue_ros.odometry.keyframe import Keyframe
from rgbd_glue_ros.odometry.pose_choice import CLEARLY_BETTER, Candidate, image_agreement
from rgbd_glue_ros.odometry.pose_refinement import (
    COARSE_LEVELS,
    FINAL_LEVEL,
    PoseEstimate,
    PoseProblem,
)
from rgbd_glue_ros.odometry.progress import LastPose
from rgbd_glue_ros.refinement.gauss_newton import Refinement, evaluate_pose
from rgbd_glue_ros.stopwatch import timed
from rgbd_glue_ros.types import Correspondences, Float64, RegistrationResult


@dataclass(frozen=True)
class TrackRegistration:
    """The registration of a frame against a keyframe, as it is in the track frame.

    Attributes:
        result: against the keyframe.
        keyframe: which.
        inlier_threshold: distance within which a match agrees with a pose, metres.
    """

    result: RegistrationResult
    keyframe: Keyframe
    inlier_threshold: float

    @property
    def T_track_camera(self) -> Float64 | None:
        """The pose of the frame, float64 [4, 4]; None where there is no transform."""
        if self.result.T_target_source is None:
            return None
        return self.keyframe.T_track_camera @ self.result.T_target_source

    @cached_property
    def matches(self) -> Correspondences:
        """All visual matches, their targets in the track frame."""
        return self.result.visual.moved_target(self.keyframe.T_track_camera)

    @cached_property
    def inliers(self) -> Correspondences:
        """Those that the transform rests on."""
        return self.result.visual_inliers.moved_target(self.keyframe.T_track_camera)


def predicted_candidate(problem: PoseProblem, acceptance: Acceptance) -> Candidate:
    """The pose that the predicted one leads to."""
    return refined_candidate(problem.predicted.T_track_camera, problem, acceptance)


def registered_candidates(
    problem: PoseProblem,
    registration: TrackRegistration,
    others: Sequence[Candidate],
    acceptance: Acceptance,
) -> list[Candidate]:
    """The poses refined from the registered transform.

    Empty if refinement from another start already got there, as in most frames. If refinement
    abandons the visual inliers, a second pose is held by them.
    """
    T_registered = registration.T_track_camera
    if T_registered is None or any(
        problem.basin.connects(other.coarse.T_model_source, T_registered) for other in others
    ):
        return []
    registered = refined_candidate(T_registered, problem, acceptance)
    inliers = registration.inliers
    if not _leaves_behind(inliers, registered, T_registered, registration.inlier_threshold):
        return [registered]
    held = replace(problem, matches=inliers)
    return [registered, refined_candidate(T_registered, held, acceptance)]


def turned_candidates(
    problem: PoseProblem, last: LastPose, acceptance: Acceptance
) -> list[Candidate]:
    """Poses refined from the whole image's rotation, at the last and at the predicted position.

    Phase correlation returns a rotation for any two images, so planes and pixels must both
    confirm it.

    Args:
        problem: the frame, and what its pose is refined by.
        last: the last frame with a pose.
        acceptance: when a pose is conclusive.
    """
    T_last, T_predicted = last.motion.T_track_camera, problem.predicted.T_track_camera
    R = T_last[:3, :3] @ turn_between(last.view, problem.view)
    turned = [
        refined_candidate(se3.from_rotation_translation(R, T[:3, 3]), problem, acceptance)
        for T in (T_predicted, T_last)
    ]
    return [candidate for candidate in turned if acceptance.is_conclusive(candidate.refinement)]


def refined_candidate(
    T_track_camera: Float64, problem: PoseProblem, acceptance: Acceptance
) -> Candidate:
    """The pose that refinement ends at from a start."""
    (estimate, coarse), ms = timed(_refined, T_track_camera, problem, acceptance)
    distance_squared = problem.predicted.distance_squared(estimate.T_track_camera)
    return Candidate(estimate, coarse, distance_squared, ms)


def _refined(
    T_track_camera: Float64, problem: PoseProblem, acceptance: Acceptance
) -> tuple[PoseEstimate, Refinement]:
    """The pose that refinement ends at from a start, and the pose after the coarse levels alone.

    Along a corridor planes agree anywhere, but for errors of their normals. Those carry a pose away
    at the coarse levels if too few pixels there hold it. So if it goes far, it is also refined
    without these levels.
    """
    coarse = problem.refined(T_track_camera, COARSE_LEVELS)
    estimate = problem.refined_further(coarse, acceptance)
    if problem.basin.connects(T_track_camera, coarse.T_model_source):
        return estimate, coarse
    near = problem.refined(T_track_camera, [FINAL_LEVEL])
    is_better = (
        acceptance.is_plausible(near)
        # with hardly a pixel to hold it, this pose may have slid as well
        and 2 * near.pixels_seen >= acceptance.min_pixels
        and image_agreement(near) > image_agreement(estimate.refinement) + CLEARLY_BETTER
    )
    if not is_better:
        return estimate, coarse
    T_near = near.T_model_source
    return PoseEstimate(near), evaluate_pose(T_near, problem, COARSE_LEVELS[-1])


def _leaves_behind(
    inliers: Correspondences, candidate: Candidate, T_registered: Float64, inlier_threshold: float
) -> bool:
    """Whether refinement has lost most of the visual inliers that it started from.

    Planes slide along themselves where there is little else.
    """
    before, after = (
        np.count_nonzero(distances(T, inliers) <= inlier_threshold)
        for T in (T_registered, candidate.estimate.T_track_camera)
    )
    return bool(2 * after < before)
