"""The pose of one frame, refined from a start: its inputs and its levels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.motion_filter import Motion, PredictedMotion
from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.refinement.gauss_newton import (
    COARSE_TO_FINE,
    START_BRIGHTNESS,
    Refinement,
    evaluate_pose,
    refine,
)
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.rolling_shutter import (
    Distortion,
    TwistMeasurement,
    distortion_at,
    twist_from_distortion,
)
from rgbd_glue_ros.types import Float64

# Most of the distance from the start is covered at these levels.
COARSE_LEVELS = COARSE_TO_FINE[:-1]
# The twist is measured here: fine enough to show the distortion, and one level before it is used.
TWIST_LEVEL = COARSE_TO_FINE[-2]
# The pose is final here, with the measured twist: in fast motion its accuracy depends on that.
FINAL_LEVEL = COARSE_TO_FINE[-1]


@dataclass(frozen=True)
class PoseEstimate:
    """A refined pose, and the twist that the frame's distortion shows.

    Attributes:
        refinement: the pose, T_track_camera, and how well the frame agrees with it.
        twist: None if it was not measured.
        distortion: how the pose depends on the twist that the view had when it was refined; None
            if that was the predicted one and this is not known.
    """

    refinement: Refinement
    twist: TwistMeasurement | None = None
    distortion: Distortion | None = None

    @property
    def T_track_camera(self) -> Float64:
        """The pose as tracked, float64 [4, 4]."""
        return self.refinement.T_model_source


@dataclass(frozen=True)
class Basin:
    """The basin of convergence: how far from a pose refinement may start and still get there.

    Attributes:
        translation: metres.
        rotation: radians.
    """

    translation: float
    rotation: float

    @staticmethod
    def of(config: OdometryConfig) -> Basin:
        """As configured."""
        return Basin(config.surprise_translation, config.surprise_rotation)

    def connects(self, T_a: Float64, T_b: Float64) -> bool:
        """Whether refinement gets from one pose to the other."""
        T = se3.inverse(T_b) @ T_a
        return bool(
            np.linalg.norm(T[:3, 3]) <= self.translation and se3.rotation_angle(T) <= self.rotation
        )


@dataclass(frozen=True)
class PoseProblem(RefinementProblem):
    """The inputs for refining the pose of a frame; its model is in the track frame.

    Attributes:
        predicted: the frame's motion, predicted without its images.
        basin: starts that are farther apart may lead to different poses.
    """

    predicted: PredictedMotion = field(kw_only=True)
    basin: Basin = field(kw_only=True)

    def refined(
        self,
        T_track_camera: Float64,
        levels: Sequence[int],
        affine_brightness: Sequence[float] | Float64 = START_BRIGHTNESS,
    ) -> Refinement:
        """A pose refined from a start, at given levels."""
        return refine(T_track_camera, self, levels, affine_brightness)

    def refined_further(self, coarse: Refinement, acceptance: Acceptance) -> PoseEstimate:
        """Refines a pose from the coarse levels to the final one, with a better twist at each.

        If the result of the final level is not plausible, the pose stays that of the coarse levels.
        The frame after a start keeps its twist: its keyframe's velocity is as unknown as its own,
        one is distorted as the other, and the pose between them is right.
        """
        if self.predicted.follows_start:
            start = coarse.T_model_source
            estimate = PoseEstimate(self.refined(start, [FINAL_LEVEL], coarse.affine_brightness))
        else:
            estimate = self._refined_with_twist(coarse)
        if acceptance.is_plausible(estimate.refinement):
            return estimate
        return PoseEstimate(evaluate_pose(coarse.T_model_source, self))

    def _refined_with_twist(self, coarse: Refinement) -> PoseEstimate:
        """The pose of the final level, and the twist that the frame's distortion shows."""
        distortion = distortion_at(coarse, self, TWIST_LEVEL)
        problem = self.with_twist_inferred_from(PoseEstimate(coarse, distortion=distortion))
        finer = problem.refined(coarse.T_model_source, [TWIST_LEVEL])
        twist, distortion = twist_from_distortion(finer, problem, TWIST_LEVEL)
        problem = self.with_twist_inferred_from(PoseEstimate(finer, twist, distortion))
        final = problem.refined(finer.T_model_source, [FINAL_LEVEL], finer.affine_brightness)
        return PoseEstimate(final, twist, replace(distortion, twist=problem.view.twist))

    def without_pixels(self) -> PoseProblem:
        """The problem with the planes of the model alone."""
        return replace(self, model=self.model.without_pixels())

    def with_twist_used_for(self, estimate: PoseEstimate) -> PoseProblem:
        """The problem with the twist that the view had when an estimate was refined."""
        if estimate.distortion is None:
            return self
        return replace(self, view=replace(self.view, twist=estimate.distortion.twist))

    def with_twist_inferred_from(self, estimate: PoseEstimate) -> PoseProblem:
        """The problem with the twist that the motion filter infers from an estimate."""
        count = self.config.residuals_per_independent_one
        twist = corrected_motion(self.predicted, estimate, count).twist
        return replace(self, view=replace(self.view, twist=twist))


def corrected_motion(
    predicted: Motion, estimate: PoseEstimate, residuals_per_independent_one: float
) -> Motion:
    """The predicted motion, corrected by a pose and, if it was measured, by the twist."""
    in_camera = se3.adjoint(estimate.T_track_camera)
    counted = estimate.refinement.information / residuals_per_independent_one
    information = in_camera.T @ counted @ in_camera
    motion = predicted.corrected(estimate.T_track_camera, information, estimate.distortion)
    if estimate.twist is None:
        return motion
    return motion.corrected_by_twist(estimate.twist.twist, estimate.twist.covariance)
