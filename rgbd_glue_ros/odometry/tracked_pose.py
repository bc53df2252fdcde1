"""The pose of a frame as tracked, with all that is known of its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.contradiction import contradiction_covariance
from rgbd_glue_ros.odometry.drift_correction import DriftCorrection
from rgbd_glue_ros.odometry.keyframe import Keyframe
from rgbd_glue_ros.odometry.motion_filter import Motion, PredictedMotion
from rgbd_glue_ros.odometry.pose_covariance import (
    PoseErrors,
    timing_covariance,
    tracked_covariance,
)
from rgbd_glue_ros.odometry.pose_refinement import corrected_motion
from rgbd_glue_ros.odometry.tracking import PoseFix
from rgbd_glue_ros.types import Float64, OdometryEstimate, TrackingState


@dataclass(frozen=True)
class TrackedPose:
    """A pose in the track frame, with its uncertainty.

    Attributes:
        motion: with the pose, smoothed by the motion filter.
        covariance: float64 [6, 6] of the pose, perturbation on the left, track frame.
        timing_covariance: float64 [6, 6], the part of it due to the time of this image alone.
        reference: the keyframe that the pose was found from.
    """

    motion: Motion
    covariance: Float64
    timing_covariance: Float64
    reference: Keyframe

    @staticmethod
    def of(
        fix: PoseFix,
        motion: Motion,
        predicted: PredictedMotion,
        errors: PoseErrors,
        acceptance: Acceptance,
    ) -> TrackedPose:
        """The pose that the motion filter makes of a fix.

        The filter smooths by errors typical of cameras; the covariance is by those of this one.

        Args:
            fix: by the images.
            motion: the predicted one, corrected by the fix.
            predicted: the motion without the images.
            errors: of the camera.
            acceptance: how many planes count as a contradiction of the fix.
        """
        by_own_errors = corrected_motion(
            predicted, fix.estimate, errors.residuals_per_independent_one
        )
        # an error of time displaces the camera by its published velocity
        by_own_errors = replace(by_own_errors, twist=motion.twist)
        covariance = tracked_covariance(by_own_errors, fix.reference, errors)
        covariance = covariance + contradiction_covariance(
            fix.estimate.refinement, fix.alternative, predicted.reach_covariance(), acceptance
        )
        timing = timing_covariance(by_own_errors, errors)
        return TrackedPose(motion, covariance, timing, fix.reference)

    @property
    def T_track_camera(self) -> Float64:
        """The pose, float64 [4, 4]."""
        return self.motion.T_track_camera

    @property
    def covariance_from_keyframe(self) -> Float64:
        """The covariance given the pose of the keyframe, float64 [6, 6]."""
        return self.covariance - self.reference.covariance

    def estimate(self, drift: DriftCorrection) -> OdometryEstimate:
        """The published pose and twist, with a drift correction applied."""
        return OdometryEstimate(
            self.motion.stamp_ns,
            TrackingState.TRACKING,
            *drift.pose_in_odom(self.T_track_camera, self.covariance),
            self.motion.twist.copy(),
            self.motion.covariance[6:, 6:].copy(),
            keyframe_id=self.reference.number,
            covariance_from_keyframe=drift.covariance_in_odom(self.covariance_from_keyframe),
        )
