"""The rotation of a camera between two images, by a gyroscope calibrated with the images.

A gyroscope measures the rotation between images better than they do; but it has a bias, and its
clock is not the camera's. Both are states of a Kalman filter that compares its rotations with those
of tracked poses, as in visual-inertial odometry (Mourikis and Roumeliotis 2007, Li and Mourikis
2014), but without any other coupling.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.gates import chi_squared, mahalanobis_squared
from rgbd_glue_ros.types import NANOSECONDS, Float64, ImuSamples, Int64

# Noise of the worst consumer sensors, rad/s/√Hz.
_NOISE = 5e-4
# Their errors of scale and axes, as a fraction of the turn.
_SCALE = 0.01
# Initial standard deviation of the bias, rad/s.
_START_BIAS = 0.03
# Initial standard deviation of the time offset, seconds.
_START_OFFSET_S = 0.03
# Random walk of the bias with temperature, rad/s/√s.
_BIAS_WALK = 1e-4
# No rotation between two frames is tracked better than this, radians, whatever the residuals say.
_LEAST_TRACKING_ERROR = 0.002
# No sensor on a camera turns faster, rad/s: greater values are faults.
_FASTEST = 100.0
# Samples farther apart than this say nothing about the time between them.
_LONGEST_GAP_S = 0.05
# Angular acceleration by a hand, rad/s²: the error of a velocity that is held beyond the samples.
_ANGULAR_ACCELERATION = 10.0
# The validation gate of a turn: a squared Mahalanobis distance that one in a thousand exceeds.
_TURN_GATE = chi_squared(0.999, 3)
# The number of turns over which doubt is averaged.
_DOUBT_MEMORY = 20
# From this doubt on the gyroscope is not used.
_DOUBTFUL = 0.5


@dataclass(frozen=True)
class Turn:
    """Measurement of a gyroscope between two images, in the camera's optical frame.

    Attributes:
        rotation_vector: float64 [3], rotation vector of R_first_last of the camera, radians.
        covariance: float64 [3, 3], covariance of ``rotation_vector``.
        angular_velocity: float64 [3], angular velocity at the later image, rad/s.
        angular_velocity_covariance: float64 [3, 3], covariance of ``angular_velocity``.
        jacobian: float64 [3, 4], derivative of the rotation by bias and time offset.
        elapsed_s: between the images, seconds.
    """

    rotation_vector: Float64
    covariance: Float64
    angular_velocity: Float64
    angular_velocity_covariance: Float64
    jacobian: Float64
    elapsed_s: float


@dataclass(frozen=True)
class Gyroscope:
    """Estimated errors of a gyroscope; immutable.

    Attributes:
        bias: float64 [3], its reading at rest, in the camera's optical frame, rad/s.
        time_offset: its stamp of a moment minus the camera's, seconds.
        covariance: float64 [4, 4], covariance of both.
        doubt: fraction of turns that disagreed with the images, the latest weighing most; 0 to 1.
    """

    bias: Float64
    time_offset: float
    covariance: Float64
    doubt: float = 0.0

    @staticmethod
    def start() -> Gyroscope:
        """The state before any measurement: no bias or offset, with their initial covariance."""
        covariance = np.diag([_START_BIAS**2] * 3 + [_START_OFFSET_S**2])
        return Gyroscope(np.zeros(3), 0.0, covariance)

    @property
    def is_trusted(self) -> bool:
        """Whether it agrees with the images; if not, its axes or its clock are wrong."""
        return self.doubt < _DOUBTFUL

    def turn(self, samples: ImuSamples, first_ns: int, last_ns: int) -> Turn | None:
        """How the camera turned between two of its stamps.

        Args:
            samples: IMU samples in the axes of the camera's optical frame.
            first_ns: stamp of the earlier image, nanoseconds.
            last_ns: stamp of the later image, nanoseconds.

        Returns:
            The turn; None if the samples do not cover the time in between.
        """
        elapsed = (last_ns - first_ns) / NANOSECONDS
        if elapsed <= 0 or not len(samples):
            return None
        seconds, velocities = self._around(samples, first_ns, last_ns)
        first, last = np.searchsorted(seconds, [0.0, elapsed])
        near = seconds[max(first - 1, 0) : last + 1]
        if not len(near) or np.diff(near, prepend=0.0, append=elapsed).max() > _LONGEST_GAP_S:
            return None
        knots = np.concatenate([[0.0], seconds[first:last], [elapsed]])
        at_knots = _interpolated(knots, seconds, velocities)
        rotation_vector = _integrated(_turned_between(knots, at_knots))
        # for so long there is no sample, and the nearest velocity is held
        held = max(elapsed - near[-1], near[0], 0.0)
        by_offset = at_knots[-1] - at_knots[0]
        jacobian = np.column_stack([-elapsed * np.eye(3), by_offset])
        to_velocity = np.column_stack([-np.eye(3), by_offset / elapsed])
        rate = len(near) / max(near[-1] - near[0], elapsed)
        turned, speed = np.linalg.norm(rotation_vector), np.linalg.norm(at_knots[-1])
        variance = (
            _NOISE**2 * elapsed
            + (_SCALE * turned) ** 2
            + (_ANGULAR_ACCELERATION * held**2 / 2) ** 2
        )
        of_velocity = _NOISE**2 * rate + (_SCALE * speed) ** 2 + (_ANGULAR_ACCELERATION * held) ** 2
        return Turn(
            rotation_vector,
            jacobian @ self.covariance @ jacobian.T + variance * np.eye(3),
            at_knots[-1],
            to_velocity @ self.covariance @ to_velocity.T + of_velocity * np.eye(3),
            jacobian,
            elapsed,
        )

    def rotations_until(self, samples: ImuSamples, stamps_ns: Int64, last_ns: int) -> Float64:
        """The rotations of ``turn`` from many stamps to a later one, integrated once.

        Args:
            samples: IMU samples in the axes of the camera's optical frame.
            stamps_ns: int64 [N], increasing, the camera's stamps, at most ``last_ns``, nanoseconds.
            last_ns: the later stamp, nanoseconds.

        Returns:
            float64 [N, 3, 3], R_last_then of the camera; the identity where the samples do not
            cover the time in between.
        """
        rotations = np.tile(np.eye(3), (len(stamps_ns), 1, 1))
        if not len(stamps_ns):
            return rotations
        first_ns = int(stamps_ns[0])
        then, end = (stamps_ns - first_ns) / NANOSECONDS, (last_ns - first_ns) / NANOSECONDS
        seconds, velocities = self._around(samples, first_ns, last_ns)
        covered = then >= _covered_since(seconds, end)
        if not covered.any():
            return rotations
        between = seconds[(seconds > then[covered][0]) & (seconds < end)]
        knots = np.unique(np.concatenate([then[covered], between, [end]]))
        steps = _turned_between(knots, _interpolated(knots, seconds, velocities))
        R_last_knot = np.empty((len(knots), 3, 3))
        R_last_knot[-1] = np.eye(3)
        for i in reversed(range(len(steps))):
            back = se3.exp(np.concatenate([np.zeros(3), -steps[i]]))[:3, :3]
            R_last_knot[i] = R_last_knot[i + 1] @ back
        rotations[covered] = R_last_knot[np.searchsorted(knots, then[covered])]
        return rotations

    def _around(self, samples: ImuSamples, first_ns: int, last_ns: int) -> tuple[Float64, Float64]:
        """Times [N] since the first of two stamps, seconds, and angular velocities [N, 3], rad/s.

        They include the samples between the stamps, and up to ``_LONGEST_GAP_S`` before and after.
        """
        offset_ns = round(self.time_offset * NANOSECONDS)
        gap_ns = round(_LONGEST_GAP_S * NANOSECONDS)
        samples = samples.between(first_ns + offset_ns - gap_ns, last_ns + offset_ns + gap_ns)
        # NaN is not below the limit either
        measured = (np.abs(samples.angular_velocity) < _FASTEST).all(axis=1)
        seconds = (samples.stamps_ns[measured] - first_ns) / NANOSECONDS - self.time_offset
        return seconds, samples.angular_velocity[measured] - self.bias

    def compared(self, turn: Turn, rotation: Float64, covariance: Float64) -> Gyroscope:
        """The state after a turn is compared with the rotation of the images.

        Args:
            turn: the result of ``turn``.
            rotation: float64 [4, 4] with the tracked rotation R_first_last.
            covariance: float64 [3, 3] of that rotation, radians².
        """
        by_gyroscope = se3.exp(np.concatenate([np.zeros(3), turn.rotation_vector]))
        innovation = se3.rotation_vector(se3.inverse(by_gyroscope) @ rotation)
        expected = turn.covariance + covariance + _LEAST_TRACKING_ERROR**2 * np.eye(3)
        surprise = mahalanobis_squared(innovation, expected) / _TURN_GATE
        doubt = self.doubt + (float(surprise > 1) - self.doubt) / _DOUBT_MEMORY
        # an almost impossible disagreement has little weight: a wrong pose, or a push
        inflated = expected * max(1.0, surprise)
        noise = inflated - turn.jacobian @ self.covariance @ turn.jacobian.T
        gain = self.covariance @ turn.jacobian.T @ np.linalg.inv(inflated)
        change = gain @ innovation
        kept = np.eye(4) - gain @ turn.jacobian
        walk = np.diag([_BIAS_WALK**2 * turn.elapsed_s] * 3 + [0.0])
        return replace(
            self,
            bias=self.bias + change[:3],
            time_offset=self.time_offset + float(change[3]),
            covariance=kept @ self.covariance @ kept.T + gain @ noise @ gain.T + walk,
            doubt=doubt,
        )


def _interpolated(knots: Float64, seconds: Float64, velocities: Float64) -> Float64:
    """Angular velocities at some times, float64 [K, 3], from those [N, 3] at other times [N]."""
    return np.stack([np.interp(knots, seconds, v) for v in velocities.T], axis=1)


def _turned_between(knots: Float64, at_knots: Float64) -> Float64:
    """The rotation vectors from each of some times [K] to the next, float64 [K - 1, 3]."""
    turned: Float64 = np.diff(knots)[:, None] * (at_knots[:-1] + at_knots[1:]) / 2
    return turned


def _integrated(steps: Float64) -> Float64:
    """The rotation vector [3] of consecutive rotations, given as rotation vectors [K, 3]."""
    T = np.eye(4)
    for step in steps:
        T = T @ se3.exp(np.concatenate([np.zeros(3), step]))
    return se3.rotation_vector(T)


def _covered_since(seconds: Float64, end: float) -> float:
    """Since when measurements at these times [N] tell the rotation up to the end, seconds.

    Infinite if they do not reach it. Before the first one, velocity is held for the longest gap.
    """
    near = seconds[: np.searchsorted(seconds, end) + 1]
    if not len(near) or end - near[-1] > _LONGEST_GAP_S:
        return np.inf
    gaps = np.flatnonzero(np.diff(near) > _LONGEST_GAP_S)
    first = near[gaps[-1] + 1] if len(gaps) else near[0]
    return float(first - _LONGEST_GAP_S) if first <= end else np.inf
