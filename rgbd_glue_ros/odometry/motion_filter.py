"""How a camera moves between frames: a Kalman filter of pose and velocity.

Poses of single frames jitter, above all in directions that the images hardly constrain; a camera
has mass and does not. The filter follows the images where they are precise, otherwise the motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.gates import POSE_GATE, mahalanobis_squared
from rgbd_glue_ros.odometry.gyroscope import Turn
from rgbd_glue_ros.odometry.speeds import (
    CHANGE_OF_SPEED,
    FASTEST,
    LOST_COVARIANCE,
    UNKNOWN_SPEED,
)
from rgbd_glue_ros.parameters import MotionConfig
from rgbd_glue_ros.refinement.rolling_shutter import Distortion
from rgbd_glue_ros.types import NANOSECONDS, Float64

# A velocity is meaningful for this long; after that the camera is expected where it was.
MEMORY_S = 0.25
# Time in which a velocity falls to a third while images do not show the motion: a camera at a bare
# wall has not always stopped, but would otherwise be said to move on for as long as it stays there.
_VELOCITY_LASTS_S = 0.5
# A hand that holds a camera hardly changes its velocity within this time.
_SAME_VELOCITY_S = 0.05
# A covariance has no digits left after a clock jump of months: time makes a motion no less certain
# than this long.
_LONGEST_S = 3600.0
_EXACT = np.zeros((6, 6))
M = TypeVar("M", bound="Motion")
# The two parts of the filter's state.
_POSE, _TWIST = slice(0, 6), slice(6, 12)


def _measurement_ratio(P: Float64, information: Float64) -> Float64:
    """(P + R)^-1 R, float64 [6, 6], of a measurement with the covariance R.

    Computed from the information R^-1: a direction in which nothing was measured has no R.
    """
    return np.asarray(np.linalg.inv(information @ P + np.eye(6)), np.float64)


@dataclass(frozen=True)
class Motion:
    """Pose and velocity at a time.

    Attributes:
        stamp_ns: of a frame.
        T_track_camera: float64 [4, 4].
        twist: float64 [6], linear and angular velocity, in the camera's frame (m/s, rad/s).
        covariance: float64 [12, 12] of pose and velocity; perturbations on the right of the pose,
            in the camera's frame.
    """

    stamp_ns: int
    T_track_camera: Float64
    twist: Float64
    covariance: Float64

    @staticmethod
    def start(stamp_ns: int, T_track_camera: Float64, pose_covariance: Float64 = _EXACT) -> Motion:
        """A known pose, by default exactly, with unknown velocity."""
        covariance = np.diag(np.concatenate([np.zeros(6), UNKNOWN_SPEED**2]))
        covariance[_POSE, _POSE] = pose_covariance
        return Motion(stamp_ns, T_track_camera, np.zeros(6), covariance)

    @property
    def pose_covariance(self) -> Float64:
        """The covariance of the pose, float64 [6, 6]."""
        return self.covariance[_POSE, _POSE]

    def predicted(self, stamp_ns: int, config: MotionConfig) -> PredictedMotion:
        """The motion at a later stamp, at constant velocity plus random accelerations."""
        elapsed = (stamp_ns - self.stamp_ns) / NANOSECONDS
        moving = min(elapsed, MEMORY_S)
        step = se3.exp(self.twist * moving)
        F = np.eye(12)
        F[:6, :6] = se3.adjoint(se3.inverse(step))
        F[:6, 6:] = moving * np.eye(6)
        # the velocity changes at the start of the step: a change spread over it would have to be
        # twice as large, and a filter that trusts its measurements would oscillate
        accelerating = min(elapsed, _LONGEST_S)
        G = np.concatenate([np.eye(6) * accelerating**2, np.eye(6) * accelerating])
        acceleration = np.diag([config.acceleration**2] * 3 + [config.angular_acceleration**2] * 3)
        covariance = F @ self.covariance @ F.T + G @ acceleration @ G.T
        # the velocity at the end is not the mean of the step, which is all that poses show
        covariance[6:, 6:] += acceleration * (accelerating / 2) ** 2
        # what the camera does after that time is unknown
        twist = self.twist * (moving / elapsed)
        return PredictedMotion(stamp_ns, self.T_track_camera @ step, twist, covariance, elapsed)

    def predicted_by(self, turn: Turn, stamp_ns: int, config: MotionConfig) -> PredictedMotion:
        """The motion at a later stamp, at constant linear velocity and with a gyroscope's rotation.

        The pose is no more certain than without it: what images leave open couples rotation and
        position, so fixing the rotation would move the error to the position.

        Args:
            turn: between this motion's stamp and the later one.
            stamp_ns: the later stamp.
            config: how the linear velocity changes.
        """
        predicted = self.predicted(stamp_ns, config)
        moving = min(predicted.elapsed_s, MEMORY_S)
        step = se3.exp(np.concatenate([self.twist[:3] * moving, turn.rotation_vector]))
        # the measured angular velocity replaces the previous one
        covariance = predicted.covariance.copy()
        covariance[9:, :] = covariance[:, 9:] = 0.0
        covariance[9:, 9:] = turn.angular_velocity_covariance
        twist = np.concatenate([predicted.twist[:3], turn.angular_velocity])
        return replace(
            predicted, T_track_camera=self.T_track_camera @ step, twist=twist, covariance=covariance
        )

    def shifted(self: M, T_shift: Float64) -> M:
        """The same motion elsewhere: poses multiplied by T_shift [4, 4] on the left."""
        return replace(self, T_track_camera=T_shift @ self.T_track_camera)

    def corrected(
        self, T_measured: Float64, information: Float64, distortion: Distortion | None = None
    ) -> Motion:
        """The motion after a measured pose.

        A measurement that is almost impossible according to the prediction is accepted: the camera
        was pushed, or found again, and the prediction was too confident.

        Args:
            T_measured: T_track_camera, float64 [4, 4].
            information: float64 [6, 6], the inverse of the covariance of the pose, perturbation on
                the right; 0 in a direction in which nothing was measured.
            distortion: how the measured pose depends on the velocity: pose and velocity are then
                corrected together, as a pose refined with a wrong velocity is wrong. Taken for
                right, it would give the next velocity the opposite error, and both would swing.
        """
        innovation = se3.log(se3.inverse(self.T_track_camera) @ T_measured)
        H = np.eye(6, 12)
        if distortion is not None:
            H[:, _TWIST] = distortion.seconds
            innovation = innovation - distortion.seconds @ (self.twist - distortion.twist)
        weight = _measurement_ratio(H @ self.covariance @ H.T, information) @ information
        distance_squared = float(innovation @ weight @ innovation)
        P = self.covariance * max(1.0, (distance_squared / POSE_GATE) ** 2)
        corrected = self._updated(P, H, innovation, information)
        if (np.abs(corrected.twist) < FASTEST).all():
            return corrected
        return Motion.start(self.stamp_ns, corrected.T_track_camera, corrected.pose_covariance)

    def at_own_keyframe(self) -> Motion:
        """The motion with its pose known exactly, from the keyframe that the frame has become."""
        covariance = self.covariance.copy()
        covariance[_POSE, :] = covariance[:, _POSE] = 0.0
        return replace(self, covariance=covariance)

    def decoupled(self: M, part: Float64) -> M:
        """The motion with no covariance between a part of pose and velocity, and the rest.

        Else, where nothing measures the part for long, millimetres in which the rest is corrected
        move it by metres: its directions are known to a few degrees only.

        Args:
            part: float64 [6, 6], a projection of twists in the camera's frame.
        """
        of_both = np.kron(np.eye(2), part)
        rest = np.eye(12) - of_both
        covariance = of_both @ self.covariance @ of_both.T + rest @ self.covariance @ rest.T
        return replace(self, covariance=covariance)

    def corrected_by_twist(self, twist: Float64, covariance: Float64) -> Motion:
        """The motion after a measured velocity; unchanged if the two disagree completely.

        Args:
            twist: float64 [6], linear and angular, in the camera's frame.
            covariance: float64 [6, 6] of ``twist``.
        """
        innovation = twist - self.twist
        expected = self.covariance[_TWIST, _TWIST] + covariance
        # a comparison with NaN is false, too
        if not mahalanobis_squared(innovation, expected) <= POSE_GATE:
            return self
        information = np.asarray(np.linalg.inv(covariance), np.float64)
        return self._updated(self.covariance, np.eye(6, 12, 6), innovation, information)

    def _updated(self, P: Float64, H: Float64, innovation: Float64, information: Float64) -> Motion:
        """The update of a Kalman filter.

        Args:
            P: float64 [12, 12], covariance of the motion before the update.
            H: float64 [6, 12], derivative of what was measured by pose and velocity.
            innovation: float64 [6], difference of the measurement from the prediction.
            information: float64 [6, 6] of the measurement.
        """
        PH = P @ H.T
        ratio = _measurement_ratio(H @ PH, information)
        gain = PH @ ratio @ information
        noise = ratio @ information @ ratio.T
        change = gain @ innovation
        # Joseph's form: the difference P - gain P has no digits left after a minute without a pose
        kept = np.eye(12) - gain @ H
        covariance = kept @ P @ kept.T + PH @ noise @ PH.T
        return Motion(
            self.stamp_ns,
            self.T_track_camera @ se3.exp(change[_POSE]),
            self.twist + change[_TWIST],
            # asymmetry from rounding grows with every update, until variances are negative
            (covariance + covariance.T) / 2,
        )


@dataclass(frozen=True)
class PredictedMotion(Motion):
    """The motion at a frame's stamp before its images are looked at.

    Attributes:
        elapsed_s: since the last pose, from which it is predicted, seconds.
    """

    elapsed_s: float

    def along(self, T_last_camera: Float64, last: Motion) -> PredictedMotion:
        """The prediction where another odometry has measured the way since the last pose.

        It is no more certain than without it. A way too long for any camera is not taken.

        Args:
            T_last_camera: float64 [4, 4], the way.
            last: the motion that this one is predicted from.
        """
        twist = se3.log(T_last_camera) / self.elapsed_s
        if not (np.abs(twist) < FASTEST).all():
            return self
        return replace(self, T_track_camera=last.T_track_camera @ T_last_camera, twist=twist)

    def found_at(self, T_track_camera: Float64) -> PredictedMotion:
        """The prediction of a camera that was found at a place, with no way to it from the last.

        The last pose was assumed: what lies between the two is its error, not the camera's motion.

        Args:
            T_track_camera: float64 [4, 4].
        """
        known = Motion.start(self.stamp_ns, T_track_camera, LOST_COVARIANCE)
        return replace(
            self, T_track_camera=T_track_camera, twist=known.twist, covariance=known.covariance
        )

    def slowed(self, part: Float64) -> PredictedMotion:
        """The prediction with less of a part of the velocity, that has not been measured for long.

        Args:
            part: float64 [6, 6], a projection of twists in the camera's frame.
        """
        forgotten = 1 - np.exp(-self.elapsed_s / _VELOCITY_LASTS_S)
        return replace(self, twist=self.twist - forgotten * part @ self.twist)

    @property
    def follows_start(self) -> bool:
        """Whether it follows so soon after an unknown velocity that it must be about the same."""
        is_unknown = (np.diag(self.covariance)[6:9] >= UNKNOWN_SPEED[:3] ** 2).all()
        return bool(is_unknown) and self.elapsed_s <= _SAME_VELOCITY_S

    def expects(self, T_track_camera: Float64) -> bool:
        """Whether a pose is possible according to the filter."""
        return mahalanobis_squared(self._error(T_track_camera), self.pose_covariance) < POSE_GATE

    def reaches(self, T_track_camera: Float64) -> bool:
        """Whether the camera can have got to a pose."""
        return self.distance_squared(T_track_camera) < POSE_GATE

    def distance_squared(self, T_track_camera: Float64) -> float:
        """The squared Mahalanobis distance of a pose from the predicted one.

        Args:
            T_track_camera: float64 [4, 4].

        Returns:
            The distance with ``reach_covariance``; no camera gets beyond ``POSE_GATE``.
        """
        return mahalanobis_squared(self._error(T_track_camera), self.reach_covariance())

    def reach_covariance(self) -> Float64:
        """How far from its predicted pose the camera can have got, float64 [6, 6].

        The filter's covariance and a change of speed as sudden as a hand can make it; perturbation
        on the right of the predicted pose.
        """
        change = CHANGE_OF_SPEED * self.elapsed_s
        return np.asarray(self.pose_covariance + np.diag(change**2), np.float64)

    def _error(self, T_track_camera: Float64) -> Float64:
        """The error of the predicted pose if this one is true, twist [6] on the right of it."""
        return se3.log(se3.inverse(self.T_track_camera) @ T_track_camera)
