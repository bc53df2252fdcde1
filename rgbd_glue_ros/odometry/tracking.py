"""Tracks a frame against the nearest keyframes: a few starts, and the one with most evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.acceptance import FEW_MATCHES, Acceptance
from rgbd_glue_ros.odometry.background import BackgroundThread, Once
from rgbd_glue_ros.odometry.candidates import (
    TrackRegistration,
    predicted_candidate,
    registered_candidates,
    turned_candidates,
)
from rgbd_glue_ros.odometry.contradiction import SettledPose, settle_contradiction
from rgbd_glue_ros.odometry.keyframe import Keyframe
from rgbd_glue_ros.odometry.motion_filter import PredictedMotion
from rgbd_glue_ros.odometry.pose_choice import Candidate, choose, is_clear
from rgbd_glue_ros.odometry.pose_covariance import is_known
from rgbd_glue_ros.odometry.pose_refinement import COARSE_LEVELS, PoseProblem
from rgbd_glue_ros.odometry.progress import LastPose
from rgbd_glue_ros.odometry.unmeasured_direction import without_spurious_motion
from rgbd_glue_ros.refinement.model import Model
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.types import (
    RegistrationResult,
    RegistrationStatus,
    TransformPrior,
    stages,
)


@dataclass(frozen=True, kw_only=True)
class PoseFix(SettledPose):
    """A pose that is believed, and what it was found from.

    Attributes:
        reference: the keyframe that the frame was registered against.
        model: what the pose was refined against, in the track frame.
    """

    reference: Keyframe
    model: Model


@dataclass(frozen=True)
class Attempt:
    """What trying to find the pose of a frame gave.

    Attributes:
        features: of the frame.
        registration: that the pose rests on, or that says why there is none.
        fix: the pose; None if there is none.
    """

    features: FrameFeatures
    registration: RegistrationResult
    fix: PoseFix | None = None

    @property
    def stages_ms(self) -> dict[str, float]:
        """The duration of each stage, milliseconds."""
        return {**self.features.stages_ms, **self.registration.stages_ms}


def track(
    problem: PoseProblem,
    nearest: Keyframe,
    last: LastPose,
    glue: Glue,
    background: BackgroundThread,
    acceptance: Acceptance,
    prior_radius: float,
) -> Attempt:
    """Registers a frame against the nearest keyframe and refines its pose against the nearest few.

    Args:
        problem: the frame, its predicted motion, and the model of the nearest few keyframes.
        nearest: the first of these.
        last: the last frame with a pose.
        glue: registers.
        background: refines the predicted pose while the frame is registered, and helps with what
            follows.
        acceptance: the evidence that a pose needs.
        prior_radius: how far the frame may be from its prediction if visual matches give no
            transform, metres; 0 does without the prediction.
    """
    uses_prior = prior_radius > 0
    predicted = background.start(predicted_candidate, problem, acceptance) if uses_prior else None
    geometric = background.start(glue.extract_geometric, problem.view)
    fix = partial(_pose_fix, nearest=nearest, problem=problem, last=last, acceptance=acceptance)
    predicted_fix = None
    # in most frames this is the pose that is chosen, and no match has a say in it
    if predicted is not None and is_known(last.motion):
        predicted_fix = background.start(lambda: fix(predicted.result(), agreeing_matches=0))
    features = glue.extract_visual(problem.view, geometric.result)
    prior = _prior(problem.predicted, nearest, prior_radius) if uses_prior else None
    result = glue.register(features, nearest.features, prior)
    registration = TrackRegistration(result, nearest, glue.inlier_threshold)
    candidates = _candidates(problem, predicted, registration, last, acceptance)
    described = features.complete()
    if not candidates:
        return Attempt(described, result)
    result = result.with_stage(stages.REFINEMENT, sum(c.milliseconds for c in candidates))
    choice = registration.matches, registration.inlier_threshold, acceptance
    chosen = choose(candidates, *choice) or choose(_where_expected(candidates, problem), *choice)
    if chosen is None:
        return Attempt(described, result.refused(RegistrationStatus.INCONSISTENT))
    if predicted_fix is not None and chosen is candidates[0]:
        return Attempt(described, result, predicted_fix.result())
    agreeing = chosen.agreeing(registration.matches, registration.inlier_threshold)
    return Attempt(described, result, fix(chosen, agreeing_matches=agreeing))


def _prior(predicted: PredictedMotion, keyframe: Keyframe, radius: float) -> TransformPrior:
    """Where to search for the transform to a keyframe: around the predicted pose."""
    T_keyframe_camera = se3.inverse(keyframe.T_track_camera) @ predicted.T_track_camera
    return TransformPrior(T_keyframe_camera, radius)


def _candidates(
    problem: PoseProblem,
    predicted: Once[Candidate] | None,
    registration: TrackRegistration,
    last: LastPose,
    acceptance: Acceptance,
) -> list[Candidate]:
    """The poses that different starts lead to: as few as make one of them clear."""
    candidates = [] if predicted is None else [predicted.result()]
    candidates += registered_candidates(problem, registration, candidates, acceptance)
    matches, threshold = registration.matches, registration.inlier_threshold
    if candidates and not any(is_clear(c, matches, threshold, acceptance) for c in candidates):
        candidates += turned_candidates(problem, last, acceptance)
    return candidates


def _where_expected(candidates: Sequence[Candidate], problem: PoseProblem) -> list[Candidate]:
    """Candidates out of the camera's reach, put back where that is for want of a measurement.

    Without texture a corridor's walls carry a pose along it by half a metre, which is farther than
    a camera gets between two frames.
    """
    put_back = []
    for candidate in candidates:
        estimate = without_spurious_motion(candidate.estimate, problem)
        distance_squared = problem.predicted.distance_squared(estimate.T_track_camera)
        put_back.append(replace(candidate, estimate=estimate, distance_squared=distance_squared))
    return put_back


def _pose_fix(
    chosen: Candidate,
    agreeing_matches: int,
    nearest: Keyframe,
    problem: PoseProblem,
    last: LastPose,
    acceptance: Acceptance,
) -> PoseFix:
    """A chosen pose, or the one that more of the frame shows; as expected where unmeasured."""
    settled = settle_contradiction(chosen, problem, last, acceptance)
    estimate = settled.estimate
    # from a start as far off as the camera may be, edges find others that look like them
    is_found = is_known(last.motion) or agreeing_matches >= FEW_MATCHES
    if not is_found or acceptance.pixels_contradict(estimate.refinement):
        # their gradients would hold the pose where nothing was measured
        problem = problem.without_pixels()
        coarse = problem.refined(estimate.T_track_camera, COARSE_LEVELS)
        estimate = problem.refined_further(coarse, acceptance)
    estimate = without_spurious_motion(estimate, problem)
    return PoseFix(
        estimate,
        settled.alternative,
        settled.T_shift,
        reference=nearest,
        model=problem.model,
    )
