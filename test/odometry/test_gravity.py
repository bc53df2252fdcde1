"""The upward direction is the mean acceleration, each turned to where the camera is now."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from raycast_room.imu import BMI055, simulated_imu
from rigs.room import true_pose

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.gravity import up_direction
from rgbd_glue_ros.odometry.gyroscope import Gyroscope
from rgbd_glue_ros.types import NANOSECONDS, Float64, ImuSamples

NOW_NS = NANOSECONDS
CALIBRATED = replace(Gyroscope.start(), bias=np.array([0.01, -0.02, 0.03]), time_offset=0.004)


def sample_by_sample(samples: ImuSamples, gyroscope: Gyroscope, stamp_ns: int) -> Float64:
    """The direction with one turn from each sample to the stamp, as it is defined."""
    offset_ns = round(gyroscope.time_offset * NANOSECONDS)
    last_ns = stamp_ns + offset_ns
    recent = samples.between(last_ns - NANOSECONDS // 2, last_ns)
    accelerations = []
    for at_ns, acceleration in zip(recent.stamps_ns, recent.linear_acceleration, strict=True):
        turn = gyroscope.turn(samples, int(at_ns) - offset_ns, stamp_ns)
        back = np.zeros(3) if turn is None else -turn.rotation_vector
        R_camera_then = se3.exp(np.concatenate([np.zeros(3), back]))[:3, :3]
        if np.isfinite(acceleration).all():
            accelerations.append(R_camera_then @ acceleration)
    mean = np.mean(accelerations, axis=0)
    return np.asarray(mean / np.linalg.norm(mean), np.float64)


@cache
def moving() -> ImuSamples:
    return simulated_imu(true_pose, -0.5, 1.5, BMI055)


def without(samples: ImuSamples, first_ms: int, last_ms: int) -> ImuSamples:
    """The samples with a gap in the second before now."""
    first_ns, last_ns = (NOW_NS + ms * NANOSECONDS // 1000 for ms in (first_ms, last_ms))
    return samples.between(-NANOSECONDS, first_ns).merged_with(
        samples.between(last_ns, 2 * NANOSECONDS)
    )


def in_turn() -> ImuSamples:
    """Turns and accelerations in messages of their own."""
    samples = moving()
    velocities, accelerations = samples.angular_velocity.copy(), samples.linear_acceleration.copy()
    velocities[::2], accelerations[1::2] = np.nan, np.nan
    return replace(samples, angular_velocity=velocities, linear_acceleration=accelerations)


@pytest.mark.parametrize("gyroscope", [Gyroscope.start(), CALIBRATED])
@pytest.mark.parametrize(
    "samples",
    [
        moving(),
        without(moving(), -300, -200),
        without(moving(), -40, 0),
        without(moving(), -100, 1000),
        without(moving(), -2000, -450),
        replace(moving(), angular_velocity=np.full_like(moving().angular_velocity, np.nan)),
    ],
    ids=["all", "a gap", "a short gap", "none lately", "a late start", "no gyroscope"],
)
def test_the_upward_direction_is_that_of_turning_each_sample_by_itself(
    samples: ImuSamples, gyroscope: Gyroscope
) -> None:
    up = up_direction(samples, gyroscope, NOW_NS)
    assert up is not None
    np.testing.assert_allclose(up, sample_by_sample(samples, gyroscope, NOW_NS), atol=1e-12)


def test_turns_and_accelerations_may_come_in_separate_messages() -> None:
    up = up_direction(in_turn(), CALIBRATED, NOW_NS)
    assert up is not None
    # between two measurements the velocity is interpolated, which an acceleration halves
    np.testing.assert_allclose(up, sample_by_sample(in_turn(), CALIBRATED, NOW_NS), atol=1e-6)


def test_the_work_grows_with_the_number_of_samples_not_with_its_square(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls = []
    exp = se3.exp

    def counted(twist: Float64) -> Float64:
        calls.append(twist)
        return exp(twist)

    monkeypatch.setattr(se3, "exp", counted)
    samples = moving()
    assert up_direction(samples, Gyroscope.start(), NOW_NS) is not None
    recent = samples.between(NOW_NS - NANOSECONDS // 2, NOW_NS)
    assert len(calls) <= len(recent) + 1
