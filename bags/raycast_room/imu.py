"""What an inertial sensor on the camera measures of its motion, with the errors of a real one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import NANOSECONDS, Float64, ImuSamples

GRAVITY = np.array([0.0, 0.0, 9.81])
"""What a sensor at rest measures, in a world whose z axis is up, m/s²."""

# Velocities and accelerations are differences over this time, seconds.
_STEP_S = 2e-3


@dataclass(frozen=True)
class ImuErrors:
    """How far off a sensor is.

    Attributes:
        rate_hz: samples a second.
        angular_noise: spectral density of the gyroscope, rad/s/√Hz.
        linear_noise: of the accelerometer, m/s²/√Hz.
        bias: what the gyroscope shows at rest, rad/s.
        time_offset: stamp of a moment less the camera's, seconds.
    """

    rate_hz: float = 200.0
    angular_noise: float = 0.0
    linear_noise: float = 0.0
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    time_offset: float = 0.0


BMI055 = ImuErrors(
    angular_noise=np.radians(0.014),
    linear_noise=150e-6 * 9.81,
    bias=(np.radians(0.8), np.radians(-1.0), np.radians(0.6)),
)
"""The sensor in RealSense cameras, by its data sheet; its bias is within 1 degree a second."""


def simulated_imu(
    T_world_camera: Callable[[float], Float64],
    first_s: float,
    last_s: float,
    errors: ImuErrors,
    start_ns: int = 0,
    seed: int = 0,
) -> ImuSamples:
    """The samples of a sensor on a camera, in the axes of its optical frame.

    Args:
        T_world_camera: the camera's pose [4, 4] at a time in seconds; the world's z axis is up.
        first_s: time of the first sample.
        last_s: no sample is later.
        errors: of the sensor.
        start_ns: stamp of time 0, nanoseconds.
        seed: of the noise.
    """
    times = np.arange(first_s, last_s, 1 / errors.rate_hz)
    rng = np.random.default_rng(seed)
    # white noise of a density, sampled at a rate
    noise = rng.standard_normal((2, len(times), 3)) * np.sqrt(errors.rate_hz)
    measured = [_true(T_world_camera, time_s) for time_s in times]
    turning, pull = (np.array(vectors) for vectors in zip(*measured, strict=True))
    return ImuSamples(
        start_ns + np.rint((times + errors.time_offset) * NANOSECONDS).astype(np.int64),
        turning + errors.bias + errors.angular_noise * noise[0],
        pull + errors.linear_noise * noise[1],
    )


def _true(T_world_camera: Callable[[float], Float64], time_s: float) -> tuple[Float64, Float64]:
    """Angular velocity and acceleration of the camera, gravity included, in its own axes."""
    before, now, after = (T_world_camera(time_s + step) for step in (-_STEP_S, 0.0, _STEP_S))
    angular_velocity = se3.rotation_vector(se3.inverse(before) @ after) / (2 * _STEP_S)
    acceleration = (before[:3, 3] - 2 * now[:3, 3] + after[:3, 3]) / _STEP_S**2
    return angular_velocity, now[:3, :3].T @ (acceleration + GRAVITY)
