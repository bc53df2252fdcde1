"""Measurements of an inertial sensor (IMU), frozen like all data in ``types``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from rgbd_glue_ros.types import Float64, Int64
from rgbd_glue_ros.types.checks import check_imu


@dataclass(frozen=True, eq=False)
class ImuSamples:
    """Measurements of an inertial sensor (IMU), in one frame's axes and in order of time.

    Attributes:
        stamps_ns: int64 [N], increasing, nanoseconds.
        angular_velocity: float64 [N, 3], rad/s; NaN where not measured.
        linear_acceleration: float64 [N, 3], m/s², at rest 9.8 upward; NaN where not measured.
    """

    stamps_ns: Int64
    angular_velocity: Float64
    linear_acceleration: Float64

    def __post_init__(self) -> None:
        """Checks the arrays.

        Raises:
            InputError: an array has another type or shape, or the stamps do not increase.
        """
        check_imu(self.stamps_ns, self.angular_velocity, self.linear_acceleration)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def rotated(self, R: Float64) -> ImuSamples:
        """These samples in the axes of another frame, to which R [3, 3] rotates vectors."""
        return replace(
            self,
            angular_velocity=self.angular_velocity @ R.T,
            linear_acceleration=self.linear_acceleration @ R.T,
        )

    def between(self, first_ns: int, last_ns: int) -> ImuSamples:
        """The samples with stamps from ``first_ns`` to ``last_ns``, inclusive."""
        ends = np.searchsorted(self.stamps_ns, [first_ns, last_ns + 1])
        return ImuSamples(*(values[slice(*ends)] for values in vars(self).values()))

    def merged_with(self, others: ImuSamples) -> ImuSamples:
        """These samples and others, in order of time; of two with one stamp, that of these."""
        before = np.searchsorted(self.stamps_ns, others.stamps_ns)
        is_new = before == np.searchsorted(self.stamps_ns, others.stamps_ns, side="right")
        both = zip(vars(self).values(), vars(others).values(), strict=True)
        return ImuSamples(
            *(np.insert(own, before[is_new], other[is_new], axis=0) for own, other in both)
        )

    @staticmethod
    def empty() -> ImuSamples:
        """No samples."""
        return ImuSamples(np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3)))


class ImuUse(Enum):
    """What an IMU beside the camera is used for."""

    NONE = "no samples"
    GRAVITY = "gravity alone: it measures no angular velocity"
    TURNS = "turns and gravity"
    DISTRUSTED = "not for turns: it disagrees with the images"


@dataclass(frozen=True, eq=False)
class ImuCalibration:
    """What was learnt about an IMU from the images.

    Attributes:
        use: what it is used for.
        bias: float64 [3], gyroscope reading at rest, in the axes of the camera's optical frame,
            rad/s.
        bias_sigmas: float64 [3], standard deviations of ``bias``.
        time_offset: the IMU's stamp of a moment minus the camera's, seconds.
        time_offset_sigma: standard deviation of ``time_offset``.
    """

    use: ImuUse
    bias: Float64
    bias_sigmas: Float64
    time_offset: float
    time_offset_sigma: float

    def values(self) -> dict[str, str | float | list[float]]:
        """The values by name and unit, as in ``metrics.json`` and diagnostics."""
        return {
            "use": self.use.value,
            "bias_rad_s": self.bias.tolist(),
            "bias_sigmas_rad_s": self.bias_sigmas.tolist(),
            "time_offset_s": self.time_offset,
            "time_offset_sigma_s": self.time_offset_sigma,
        }
