"""How a camera moves between frames: a Kalman filter of pose and velocity.

Poses of single frames jitter, above all in directions that the images hardly constrain; a camera
has mass and does not. The filter follows the images where they are precise, otherwise the motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import SURPRISE, mahalanobis_squared
from rgbd_glue_ros.odometry.gyroscope import Turn
from rgbd_glue_ros.parameters import MotionConfig
from rgbd_glue_ros.types import NANOSECONDS, Float64

# A velocity is meaningful for this long; after that the camera is expected where it was.
MEMORY_S = 0.25
# Initial standard deviations: a camera on a robot or in a hand, m/s and rad/s.
_START_SPEED = np.array([1.0] * 3 + [1.0] * 3)
# How much a camera with a usable image may change its speed between two frames, m/s and rad/s.
_CHANGE_OF_SPEED = np.array([1.0] * 3 + [1.5] * 3)
# No camera with a usable image moves faster: it was found again elsewhere.
_FASTEST = np.array([5.0] * 3 + [10.0] * 3)
LOST_SPREAD = np.diag([1.0, 1.0, 1.0, 0.5, 0.5, 0.5]) ** 2
"""How far a pose may be off a second after it was lost, float64 [6, 6], m² and rad².

A hand-held camera or a robot indoors.
"""
# No pose is off by more; after a clock jump of months, a covariance would have no digits left.
_FARTHEST_SPREAD = np.diag([1e3] * 3 + [np.pi] * 3) ** 2
# The two parts of the filter's state.
_POSE, _TWIST = slice(0, 6), slice(6, 12)


def lost_spread(seconds: float) -> Float64:
    """How far a pose may be off after being lost for a time, float64 [6, 6], m² and rad²."""
    spread: Float64 = np.minimum(LOST_SPREAD * seconds**2, _FARTHEST_SPREAD)
    return spread


@dataclass(frozen=True)
class Motion:
    """Pose and velocity at a time.

    Attributes:
        stamp_ns: of the last frame that had a pose.
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
    def start(stamp_ns: int, T_track_camera: Float64) -> Motion:
        """A known pose with unknown velocity."""
        covariance = np.diag(np.concatenate([np.zeros(6), _START_SPEED**2]))
        return Motion(stamp_ns, T_track_camera, np.zeros(6), covariance)

    def predicted(self, stamp_ns: int, config: MotionConfig) -> Motion:
        """The motion at a later stamp, at constant velocity plus random accelerations."""
        elapsed = (stamp_ns - self.stamp_ns) / NANOSECONDS
        moving = min(elapsed, MEMORY_S)
        step = se3.exp(self.twist * moving)
        F = np.eye(12)
        F[:6, :6] = se3.adjoint(se3.inverse(step))
        F[:6, 6:] = moving * np.eye(6)
        # the velocity changes at the start of the step: a change spread over it would have to be
        # twice as large, and a filter that trusts its measurements would oscillate
        G = np.concatenate([np.eye(6) * elapsed**2, np.eye(6) * elapsed])
        acceleration = np.diag([config.acceleration**2] * 3 + [config.angular_acceleration**2] * 3)
        covariance = F @ self.covariance @ F.T + G @ acceleration @ G.T
        # the velocity at the end is not the mean of the step, which is all that poses show
        covariance[6:, 6:] += acceleration * (elapsed / 2) ** 2
        # what the camera does after that time is unknown
        twist = self.twist * (moving / elapsed)
        return Motion(stamp_ns, self.T_track_camera @ step, twist, covariance)

    def predicted_by(self, turn: Turn, stamp_ns: int, config: MotionConfig) -> Motion:
        """The motion at a later stamp, at constant linear velocity and with a gyroscope's rotation.

        The pose is no more certain than without it: what images leave open couples rotation and
        position, so fixing the rotation would move the error to the position.

        Args:
            turn: between this motion's stamp and the later one.
            stamp_ns: the later stamp.
            config: how the linear velocity changes.
        """
        predicted = self.predicted(stamp_ns, config)
        moving = min((stamp_ns - self.stamp_ns) / NANOSECONDS, MEMORY_S)
        step = se3.exp(np.concatenate([self.twist[:3] * moving, turn.rotation_vector]))
        # the measured angular velocity replaces the previous one
        covariance = predicted.covariance.copy()
        covariance[9:, :] = covariance[:, 9:] = 0.0
        covariance[9:, 9:] = turn.angular_velocity_covariance
        twist = np.concatenate([predicted.twist[:3], turn.angular_velocity])
        return Motion(stamp_ns, self.T_track_camera @ step, twist, covariance)

    def shifted(self, T_shift: Float64) -> Motion:
        """The same motion elsewhere: poses multiplied by T_shift [4, 4] on the left."""
        return replace(self, T_track_camera=T_shift @ self.T_track_camera)

    def expects(self, T_track_camera: Float64) -> bool:
        """Whether a pose is possible according to the filter, at its stamp."""
        way = se3.log(se3.inverse(self.T_track_camera) @ T_track_camera)
        return mahalanobis_squared(way, self.covariance[_POSE, _POSE]) < SURPRISE

    def reaches(self, T_track_camera: Float64, predicted: Motion) -> bool:
        """Whether a camera that was last here can have reached a pose, in terms of ``surprise``."""
        return self.surprise(T_track_camera, predicted) < SURPRISE

    def surprise(self, T_track_camera: Float64, predicted: Motion) -> float:
        """How far a camera that was last here is from where it is expected now.

        Args:
            T_track_camera: where it is, float64 [4, 4].
            predicted: where it is expected.

        Returns:
            The squared Mahalanobis distance; ``SURPRISE`` is what no camera exceeds.
        """
        way = se3.log(se3.inverse(predicted.T_track_camera) @ T_track_camera)
        return mahalanobis_squared(way, self.spread(predicted))

    def spread(self, predicted: Motion) -> Float64:
        """How far from where it is expected a camera that was last here may be.

        Args:
            predicted: where it is expected.

        Returns:
            The covariance [6, 6], perturbation on the right of the predicted pose.
        """
        elapsed = (predicted.stamp_ns - self.stamp_ns) / NANOSECONDS
        covariance: Float64 = predicted.covariance[_POSE, _POSE] + np.diag(
            (_CHANGE_OF_SPEED * elapsed) ** 2
        )
        return covariance

    def corrected(self, T_measured: Float64, covariance: Float64) -> Motion:
        """The motion after a measured pose.

        A measurement that is almost impossible according to the prediction is accepted: the camera
        was pushed, or found again, and the prediction was too confident.

        Args:
            T_measured: T_track_camera, float64 [4, 4].
            covariance: float64 [6, 6] of the pose, perturbation on the right.
        """
        innovation = se3.log(se3.inverse(self.T_track_camera) @ T_measured)
        surprise = mahalanobis_squared(innovation, self.covariance[_POSE, _POSE] + covariance)
        P = self.covariance * max(1.0, (surprise / SURPRISE) ** 2)
        corrected = self._updated(P, _POSE, innovation, covariance)
        if (np.abs(corrected.twist) < _FASTEST).all():
            return corrected
        start = Motion.start(self.stamp_ns, corrected.T_track_camera)
        start.covariance[:6, :6] = corrected.covariance[:6, :6]
        return start

    def corrected_by_twist(self, twist: Float64, covariance: Float64) -> Motion:
        """The motion after a measured velocity; unchanged if the two disagree completely.

        Args:
            twist: float64 [6], linear and angular, in the camera's frame.
            covariance: float64 [6, 6] of ``twist``.
        """
        innovation = twist - self.twist
        expected = self.covariance[_TWIST, _TWIST] + covariance
        # a comparison with NaN is false, too
        if not mahalanobis_squared(innovation, expected) <= SURPRISE:
            return self
        return self._updated(self.covariance, _TWIST, innovation, covariance)

    def _updated(
        self, P: Float64, measured: slice, innovation: Float64, covariance: Float64
    ) -> Motion:
        """The update of a Kalman filter.

        Args:
            P: float64 [12, 12], covariance of the motion before the update.
            measured: which of pose and velocity was measured.
            innovation: float64 [6], difference of the measurement from the prediction.
            covariance: float64 [6, 6] of the measurement.
        """
        gain = P[:, measured] @ np.linalg.inv(P[measured, measured] + covariance)
        change = gain @ innovation
        # Joseph's form: the difference P - gain P has no digits left after a minute without a pose
        kept = np.eye(12)
        kept[:, measured] -= gain
        return replace(
            self,
            T_track_camera=self.T_track_camera @ se3.exp(change[_POSE]),
            twist=self.twist + change[_TWIST],
            covariance=kept @ P @ kept.T + gain @ covariance @ gain.T,
        )
