"""The IMU on the camera: predicts rotation, and measures the upward direction."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.gravity import up_direction
from rgbd_glue_ros.odometry.gyroscope import Gyroscope
from rgbd_glue_ros.odometry.motion_filter import Motion, PredictedMotion
from rgbd_glue_ros.odometry.pose_covariance import covariance_of
from rgbd_glue_ros.odometry.pose_refinement import PoseEstimate
from rgbd_glue_ros.parameters import MotionConfig
from rgbd_glue_ros.types import NANOSECONDS, Float64, ImuCalibration, ImuSamples, ImuUse

# Over a longer time a turn accumulates too much bias to be useful.
_LONGEST_TURN_NS = 10 * NANOSECONDS
# Samples are kept for that time, plus the possible difference of clocks.
_KEPT_NS = _LONGEST_TURN_NS + NANOSECONDS
# Poses farther apart are not compared with a turn: the camera was lost in between.
_LONGEST_COMPARED_NS = NANOSECONDS // 2


@dataclass(frozen=True)
class _TrackedRotation:
    """The pose of a frame from its images only, with the covariance of its rotation."""

    stamp_ns: int
    T_track_camera: Float64
    covariance: Float64


@dataclass(frozen=True)
class Inertial:
    """The samples of an IMU, and its estimated errors; immutable.

    Attributes:
        samples: the latest samples, in the axes of the camera's optical frame.
        gyroscope: the estimated errors of the gyroscope.
    """

    samples: ImuSamples = field(default_factory=ImuSamples.empty)
    gyroscope: Gyroscope = field(default_factory=Gyroscope.start)
    _last: _TrackedRotation | None = None

    def with_samples(self, samples: ImuSamples) -> Inertial:
        """The state with more samples, in any order: one wrong stamp must not shut out others."""
        return replace(self, samples=self.samples.merged_with(samples))

    def at_frame(self, stamp_ns: int) -> Inertial:
        """The state without samples that no frame from this stamp on needs."""
        if not len(self.samples) or self.samples.stamps_ns[0] >= stamp_ns - 2 * _KEPT_NS:
            return self
        newest_ns = int(self.samples.stamps_ns[-1])
        return replace(self, samples=self.samples.between(stamp_ns - _KEPT_NS, newest_ns))

    def predicted(self, motion: Motion, stamp_ns: int, config: MotionConfig) -> PredictedMotion:
        """The motion at a later stamp, predicted with the gyroscope if that is possible."""
        elapsed_ns = stamp_ns - motion.stamp_ns
        if elapsed_ns > _LONGEST_TURN_NS or not self.gyroscope.is_trusted:
            return motion.predicted(stamp_ns, config)
        turn = self.gyroscope.turn(self.samples, motion.stamp_ns, stamp_ns)
        if turn is None:
            return motion.predicted(stamp_ns, config)
        return motion.predicted_by(turn, stamp_ns, config)

    @property
    def calibration(self) -> ImuCalibration:
        """The estimated errors of the IMU, and what it is used for."""
        sigmas = np.sqrt(np.diag(self.gyroscope.covariance))
        return ImuCalibration(
            self._use(),
            self.gyroscope.bias,
            sigmas[:3],
            self.gyroscope.time_offset,
            float(sigmas[3]),
        )

    def _use(self) -> ImuUse:
        if not len(self.samples):
            return ImuUse.NONE
        if np.isnan(self.samples.angular_velocity).all():
            return ImuUse.GRAVITY
        return ImuUse.TURNS if self.gyroscope.is_trusted else ImuUse.DISTRUSTED

    def up(self, stamp_ns: int) -> Float64 | None:
        """The direction away from the earth at a stamp, as in ``up_direction``."""
        return up_direction(self.samples, self.gyroscope, stamp_ns)

    def start_anew(self) -> Inertial:
        """The state where poses do not go on from the last one: no rotation leads from it."""
        return replace(self, _last=None)

    def after_pose(
        self, stamp_ns: int, pose: PoseEstimate, residuals_per_independent_one: float
    ) -> Inertial:
        """The state after a frame has its pose.

        Args:
            stamp_ns: stamp of the frame, nanoseconds.
            pose: pose from its images.
            residuals_per_independent_one: how many of its residuals count as one.
        """
        if not len(self.samples):
            return self
        T, information = pose.T_track_camera, pose.refinement.information
        tracked = covariance_of(information, residuals_per_independent_one)
        covariance = se3.transported_covariance(se3.inverse(T), tracked)[3:, 3:]
        now = _TrackedRotation(stamp_ns, T, covariance)
        last = self._last
        turn = None
        if last is not None and stamp_ns - last.stamp_ns <= _LONGEST_COMPARED_NS:
            turn = self.gyroscope.turn(self.samples, last.stamp_ns, stamp_ns)
        if last is None or turn is None:
            return replace(self, _last=now)
        moved = se3.inverse(last.T_track_camera) @ now.T_track_camera
        gyroscope = self.gyroscope.compared(turn, moved, last.covariance + now.covariance)
        return replace(self, gyroscope=gyroscope, _last=now)
