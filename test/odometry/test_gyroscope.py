"""A gyroscope's turns are the integral of what it measured, and its errors are learnt."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from raycast_room.imu import BMI055, ImuErrors, simulated_imu
from rigs.room import true_pose, true_twist

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.gyroscope import Gyroscope
from rgbd_glue_ros.types import NANOSECONDS, Float64, ImuSamples

MILLISECOND = NANOSECONDS // 1000
PERIOD_NS = NANOSECONDS // 30
# as precisely as images tell how a frame is turned, radians
TRACKED = 0.002


def constant(angular_velocity: Float64, stamps_ms: range) -> ImuSamples:
    stamps = np.array(stamps_ms, np.int64) * MILLISECOND
    velocities = np.tile(np.asarray(angular_velocity, np.float64), (len(stamps), 1))
    return ImuSamples(stamps, velocities, np.full_like(velocities, np.nan))


def without(samples: ImuSamples, first_ms: int, last_ms: int) -> ImuSamples:
    """The samples with a gap."""
    ends = first_ms * MILLISECOND, last_ms * MILLISECOND
    return samples.between(0, ends[0]).merged_with(samples.between(ends[1], 10 * NANOSECONDS))


def true_turn(first_s: float, last_s: float) -> Float64:
    return se3.inverse(true_pose(first_s)) @ true_pose(last_s)


@pytest.mark.parametrize("last_ms", [33, 67, 250])
def test_a_constant_velocity_gives_a_turn_of_velocity_times_time(last_ms: int) -> None:
    velocity = np.array([0.3, -1.2, 0.5])
    turn = Gyroscope.start().turn(constant(velocity, range(0, 500, 5)), 0, last_ms * MILLISECOND)
    assert turn is not None
    np.testing.assert_allclose(turn.rotation_vector, velocity * last_ms / 1000, atol=1e-12)
    np.testing.assert_allclose(turn.angular_velocity, velocity, atol=1e-12)


def test_a_turn_about_changing_axes_is_that_of_the_motion() -> None:
    samples = simulated_imu(true_pose, 0.0, 1.0, ImuErrors())
    turn = Gyroscope.start().turn(samples, NANOSECONDS // 5, NANOSECONDS // 2)
    assert turn is not None
    expected = se3.rotation_vector(true_turn(0.2, 0.5))
    np.testing.assert_allclose(turn.rotation_vector, expected, atol=2e-4)
    np.testing.assert_allclose(turn.angular_velocity, true_twist(0.5)[3:], atol=5e-3)


def test_known_bias_and_time_offset_are_corrected() -> None:
    errors = ImuErrors(bias=(0.02, -0.01, 0.015), time_offset=0.04)
    samples = simulated_imu(true_pose, 0.0, 1.0, errors)
    known = replace(Gyroscope.start(), bias=np.array(errors.bias), time_offset=0.04)
    turn = known.turn(samples, NANOSECONDS // 5, NANOSECONDS // 2)
    assert turn is not None
    expected = se3.rotation_vector(true_turn(0.2, 0.5))
    np.testing.assert_allclose(turn.rotation_vector, expected, atol=2e-4)


@pytest.mark.parametrize(
    "samples",
    [
        ImuSamples.empty(),
        constant(np.ones(3), range(200, 500, 5)),
        constant(np.ones(3), range(0, 40, 5)),
        without(constant(np.ones(3), range(0, 500, 5)), 40, 95),
        constant(np.full(3, np.nan), range(0, 500, 5)),
        constant(np.full(3, 1e300), range(0, 500, 5)),
    ],
    ids=["none", "later", "earlier", "with a gap", "of an accelerometer alone", "absurd"],
)
def test_samples_that_do_not_cover_the_time_give_no_turn(samples: ImuSamples) -> None:
    assert Gyroscope.start().turn(samples, 0, 100 * MILLISECOND) is None


def test_if_samples_are_a_few_periods_late_the_last_one_is_held_with_less_certainty() -> None:
    velocity = np.array([0.0, 0.5, 0.0])
    whole, late = (
        Gyroscope.start().turn(constant(velocity, range(0, end, 5)), 0, 100 * MILLISECOND)
        for end in (200, 85)
    )
    assert whole is not None
    assert late is not None
    np.testing.assert_allclose(late.rotation_vector, whole.rotation_vector, atol=1e-12)
    assert late.covariance[0, 0] > 1.05 * whole.covariance[0, 0]


def learnt(samples: ImuSamples, seconds: float, axes: Float64, seed: int = 0) -> Gyroscope:
    """The gyroscope after its turns were compared with those of noisy images at 30 Hz.

    Args:
        samples: of the hand-held motion.
        seconds: for how long.
        axes: of the sensor in the camera, [4, 4].
        seed: of the images' noise.
    """
    rng = np.random.default_rng(seed)
    turned = samples.rotated(axes[:3, :3])
    gyroscope = Gyroscope.start()
    images = [
        true_pose(i * PERIOD_NS / NANOSECONDS)
        @ se3.exp(np.concatenate([np.zeros(3), rng.normal(0, TRACKED, 3)]))
        for i in range(round(seconds * 30))
    ]
    for i, (first, last) in enumerate(itertools.pairwise(images)):
        turn = gyroscope.turn(turned, i * PERIOD_NS, (i + 1) * PERIOD_NS)
        if turn is not None:
            covariance = 2 * TRACKED**2 * np.eye(3)
            gyroscope = gyroscope.compared(turn, se3.inverse(first) @ last, covariance)
    return gyroscope


@pytest.mark.parametrize("time_offset", [0.0, 0.02, -0.035])
def test_bias_and_time_offset_are_recovered(time_offset: float) -> None:
    errors = replace(BMI055, time_offset=time_offset)
    samples = simulated_imu(true_pose, -0.2, 12.0, errors)
    gyroscope = learnt(samples, 10.0, np.eye(4))
    off = np.append(gyroscope.bias - errors.bias, gyroscope.time_offset - time_offset)
    sigmas = np.sqrt(np.diag(gyroscope.covariance))
    assert (np.abs(off) < 3 * sigmas).all()
    assert (np.abs(off[:3]) < np.radians(0.3)).all()
    assert abs(off[3]) < 0.006
    assert gyroscope.is_trusted


def test_a_gyroscope_with_wrong_axes_is_not_trusted_until_it_agrees_with_the_images() -> None:
    samples = simulated_imu(true_pose, -0.2, 4.0, BMI055)
    half_turn = se3.exp(np.array([0, 0, 0, np.pi, 0, 0]))
    assert not learnt(samples, 3.5, half_turn).is_trusted
    assert learnt(samples, 3.5, np.eye(4)).is_trusted


def test_one_wrong_pose_hardly_changes_the_bias() -> None:
    samples = simulated_imu(true_pose, -0.2, 4.0, BMI055)
    before = learnt(samples, 3.0, np.eye(4))
    turn = before.turn(samples, NANOSECONDS, NANOSECONDS + PERIOD_NS)
    assert turn is not None
    wrong = true_turn(1.0, 1.0 + PERIOD_NS / NANOSECONDS) @ se3.exp(np.array([0, 0, 0, 0.5, 0, 0]))
    after = before.compared(turn, wrong, 2 * TRACKED**2 * np.eye(3))
    assert np.abs(after.bias - before.bias).max() < 2e-3
    assert after.is_trusted
