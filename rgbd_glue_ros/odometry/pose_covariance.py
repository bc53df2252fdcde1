"""How uncertain poses are: by what residuals show, and by what they cannot show."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.keyframe import Keyframe
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.odometry.speeds import LOST_COVARIANCE
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.refinement.reliability import SAME_DIRECTION
from rgbd_glue_ros.types import Float64

UNKNOWN = 0.25
"""Standard deviation from its keyframe, metres or radians, beyond which a pose is not known.

Of a pose that images show it is a few millimetres or centimetres.
"""


@dataclass(frozen=True)
class PoseErrors:
    """The errors of a camera's poses that the residuals of one frame do not tell.

    Attributes:
        residuals_per_independent_one: how many residuals count as one, as they err alike.
        timing_error: standard deviation of the time of an image, seconds.
        scale_error: standard deviation of the camera's scale, as a fraction.
    """

    residuals_per_independent_one: float
    timing_error: float
    scale_error: float

    @staticmethod
    def of(config: Config) -> PoseErrors:
        """As configured: typical of cameras, or learnt about one."""
        return PoseErrors(
            config.refine.residuals_per_independent_one,
            config.odometry.timing_error,
            config.odometry.scale_error,
        )

    def applied_to(self, config: Config) -> Config:
        """The configuration with these errors."""
        count = self.residuals_per_independent_one
        timing, scale = self.timing_error, self.scale_error
        return replace(
            config,
            refine=replace(config.refine, residuals_per_independent_one=count),
            odometry=replace(config.odometry, timing_error=timing, scale_error=scale),
        )


def refined_covariance(
    refinement: Refinement, T_model_anchor: Float64, twist: Float64, errors: PoseErrors
) -> Float64:
    """Covariance [6, 6] of a refined pose, perturbation on the left, in the model's frame.

    Args:
        refinement: the pose.
        T_model_anchor: pose of the camera that the model is of, float64 [4, 4].
        twist: velocity [6] of the camera whose pose it is.
        errors: of that camera.
    """
    T = refinement.T_model_source
    seen = covariance_of(refinement.information, errors.residuals_per_independent_one)
    distance = float(np.linalg.norm(T[:3, 3] - T_model_anchor[:3, 3]))
    unseen = _unseen_covariance(twist, distance, errors)
    return seen + se3.transported_covariance(T, unseen)


def covariance_of(information: Float64, residuals_per_independent_one: float) -> Float64:
    """Covariance [6, 6] of a refined pose, perturbation on the left, positive definite.

    A direction that no residual shows is as uncertain as the pose of a lost camera.

    Args:
        information: float64 [6, 6] of its residuals, if each counted.
        residuals_per_independent_one: how many of these count as one.
    """
    counted = information / residuals_per_independent_one
    return np.asarray(np.linalg.inv(counted + np.linalg.inv(LOST_COVARIANCE)), np.float64)


def unmeasured_part(refinement: Refinement, residuals_per_independent_one: float) -> Float64:
    """``uncertain_part`` of a refined pose, as far as its own residuals tell."""
    covariance = covariance_of(refinement.information, residuals_per_independent_one)
    T_camera_model = se3.inverse(refinement.T_model_source)
    return uncertain_part(se3.transported_covariance(T_camera_model, covariance))


def is_known(motion: Motion) -> bool:
    """Whether a pose is known from its keyframe in all directions; not so long at a bare wall."""
    return not uncertain_part(motion.pose_covariance).any()


def uncertain_part(covariance: Float64) -> Float64:
    """What of a twist is along directions in which a pose is not known: a matrix [6, 6].

    There its standard deviation is ``UNKNOWN`` or more, in metres and radians.

    Args:
        covariance: float64 [6, 6] of the pose, perturbation on the right.

    Returns:
        A projection of twists in the camera's frame; 0 where the pose is known.
    """
    variances, directions = np.linalg.eigh(covariance)
    uncertain = directions[:, variances >= UNKNOWN**2]
    return np.asarray(uncertain @ uncertain.T, np.float64)


def tilt_covariance(covariance: Float64) -> Float64:
    """What a covariance lacks as noise tilts directions in which the pose is not known, [6, 6].

    Such directions are known to some degrees only, so that a pose that is off by a metre along them
    is off by centimetres across them too. It is 0 for a pose that is known.

    Args:
        covariance: float64 [6, 6] of the pose, perturbation on the right.
    """
    along = np.trace(uncertain_part(covariance) @ covariance)
    return np.asarray((1 - SAME_DIRECTION**2) * along * np.eye(6), np.float64)


def tracked_covariance(motion: Motion, reference: Keyframe, errors: PoseErrors) -> Float64:
    """Covariance [6, 6] of a tracked pose, perturbation on the left, track frame.

    The sum of that of its keyframe, that of the motion, and what no residual shows.

    Args:
        motion: with the pose.
        reference: keyframe that the pose was found from.
        errors: of the camera.
    """
    T = motion.T_track_camera
    distance = float(np.linalg.norm(T[:3, 3] - reference.T_track_camera[:3, 3]))
    unseen = _unseen_covariance(motion.twist, distance, errors)
    from_keyframe = motion.pose_covariance + unseen
    return reference.covariance + se3.transported_covariance(T, from_keyframe)


def timing_covariance(motion: Motion, errors: PoseErrors) -> Float64:
    """The part of ``tracked_covariance`` due to the time of this image alone, float64 [6, 6].

    Args:
        motion: with the pose.
        errors: of the camera.
    """
    in_camera = _timing_covariance_in_camera(motion.twist, errors)
    return se3.transported_covariance(motion.T_track_camera, in_camera)


def _unseen_covariance(twist: Float64, distance: float, errors: PoseErrors) -> Float64:
    """The part of a relative pose's covariance that no residual shows: errors of time and scale.

    Args:
        twist: velocity [6] of the camera.
        distance: from the keyframe, metres.
        errors: of the camera.

    Returns:
        float64 [6, 6], in the camera's frame.
    """
    scale = np.diag([(errors.scale_error * distance) ** 2] * 3 + [0.0] * 3)
    return np.asarray(_timing_covariance_in_camera(twist, errors) + scale, np.float64)


def _timing_covariance_in_camera(twist: Float64, errors: PoseErrors) -> Float64:
    """Covariance of an error in the time of an image, float64 [6, 6], in the camera's frame."""
    metres, radians = errors.timing_error * np.linalg.norm(twist.reshape(2, 3), axis=1)
    return np.diag([metres**2] * 3 + [radians**2] * 3)
