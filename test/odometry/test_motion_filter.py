"""The filter of pose and velocity: Kalman's, consistent with its own model, and not stubborn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs.geometry import SEEDS, transforms
from scipy.stats import chi2

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.parameters import MotionConfig
from rgbd_glue_ros.refinement.rolling_shutter import Distortion
from rgbd_glue_ros.types import NANOSECONDS, Float64

PERIOD_NS = NANOSECONDS // 30
PERIOD_S = PERIOD_NS / NANOSECONDS
CONFIG = MotionConfig()
VELOCITY = np.array([0.3, -0.1, 0.5, 0.2, -0.3, 0.1])
ACCELERATION = np.repeat([CONFIG.acceleration, CONFIG.angular_acceleration], 3)


def moving(velocity: Float64, T: Float64 | None = None) -> Motion:
    covariance = np.diag([1e-4] * 6 + [1e-2] * 6)
    return Motion(0, np.eye(4) if T is None else T, velocity, covariance)


def at(position: Float64) -> Float64:
    return se3.from_rotation_translation(np.eye(3), position)


@given(transforms())
def test_a_start_is_a_known_pose_and_an_unknown_velocity(T: Float64) -> None:
    motion = Motion.start(5, T)
    np.testing.assert_array_equal(motion.T_track_camera, T)
    np.testing.assert_array_equal(motion.twist, np.zeros(6))
    assert (np.diag(motion.covariance)[:6] == 0).all()
    assert (np.diag(motion.covariance)[6:] > 0.1).all()


def test_a_moving_camera_is_predicted_to_continue_in_its_own_direction() -> None:
    # a quarter turn to the left: forward is then along the odom frame's -x
    left = se3.exp(np.array([0, 0, 0, 0, -np.pi / 2, 0]))
    predicted = moving(np.array([0, 0, 0.6, 0, 0, 0]), left).predicted(PERIOD_NS, CONFIG)
    np.testing.assert_allclose(predicted.T_track_camera[:3, 3], [-0.02, 0, 0], atol=1e-9)
    assert predicted.stamp_ns == PERIOD_NS


def test_after_a_long_gap_the_camera_is_not_predicted_to_have_moved_on_forever() -> None:
    predicted = moving(np.array([0, 0, 1.0, 0, 0, 0])).predicted(60 * NANOSECONDS, CONFIG)
    assert np.linalg.norm(predicted.T_track_camera[:3, 3]) < 1.0
    assert np.linalg.norm(predicted.twist) < 0.1
    assert np.sqrt(predicted.covariance[0, 0]) > 1.0


def test_after_a_clock_jump_of_decades_a_measured_pose_is_as_certain_as_ever() -> None:
    predicted = moving(np.array([0, 0, 1.0, 0, 0, 0])).predicted(
        1_800_000_000 * NANOSECONDS, CONFIG
    )
    measured = np.diag([1e-3**2] * 6)
    covariance = predicted.corrected(np.eye(4), np.linalg.inv(measured)).covariance[:6, :6]
    np.testing.assert_allclose(np.diag(covariance), np.diag(measured), rtol=0.1)


@pytest.mark.slow
def test_the_predicted_covariance_is_that_of_sampled_predictions() -> None:
    rng = np.random.default_rng(0)
    start = moving(np.array([0.3, -0.2, 0.4, 0.5, -0.3, 0.2]))
    expected = start.predicted(PERIOD_NS, CONFIG)
    samples = []
    for _ in range(4000):
        error = rng.multivariate_normal(np.zeros(12), start.covariance)
        velocity = start.twist + error[6:] + rng.normal(0, ACCELERATION) * PERIOD_S
        T = start.T_track_camera @ se3.exp(error[:6]) @ se3.exp(velocity * PERIOD_S)
        off = se3.log(se3.inverse(expected.T_track_camera) @ T)
        velocity = velocity + rng.normal(0, ACCELERATION) * PERIOD_S / 2
        samples.append(np.concatenate([off, velocity - start.twist]))
    sampled = np.cov(np.array(samples).T)
    scale = np.sqrt(np.diag(expected.covariance))
    # a correlation of 4000 samples has a standard error of 0.016 at most, and a variance of 0.022
    difference = (sampled - expected.covariance) / np.outer(scale, scale)
    assert np.abs(difference).max() < 5 * 0.022


@given(SEEDS)
def test_without_rotation_the_motion_filter_is_the_linear_kalman_filter(seed: int) -> None:
    """Written out for positions and velocities, where everything is linear."""
    rng = np.random.default_rng(seed)
    start = moving(np.concatenate([rng.normal(0, 0.5, 3), np.zeros(3)]))
    # a doubtful rotation would make the position doubtful too
    covariance = np.diag([1e-4] * 3 + [0.0] * 3 + [1e-2] * 3 + [0.0] * 3)
    start = replace(start, T_track_camera=at(rng.normal(0, 1, 3)), covariance=covariance)
    x = np.concatenate([start.T_track_camera[:3, 3], start.twist[:3]])
    rows = np.r_[0:3, 6:9]
    P = start.covariance[np.ix_(rows, rows)]
    F = np.block([[np.eye(3), PERIOD_S * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
    G = np.concatenate([PERIOD_S**2 * np.eye(3), PERIOD_S * np.eye(3)]) * CONFIG.acceleration
    x, P = F @ x, F @ P @ F.T + G @ G.T
    P[3:, 3:] += np.eye(3) * (CONFIG.acceleration * PERIOD_S / 2) ** 2
    R = np.diag(rng.uniform(1e-6, 1e-3, 3))
    measured = x[:3] + rng.multivariate_normal(np.zeros(3), (P[:3, :3] + R) / 4)
    K = P[:, :3] @ np.linalg.inv(P[:3, :3] + R)
    x, P = x + K @ (measured - x[:3]), P - K @ P[:3]

    noise = np.diag([*np.diag(R), 1e-4, 1e-4, 1e-4])
    corrected = start.predicted(PERIOD_NS, CONFIG).corrected(at(measured), np.linalg.inv(noise))
    np.testing.assert_allclose(corrected.T_track_camera[:3, 3], x[:3], atol=1e-9)
    np.testing.assert_allclose(corrected.twist[:3], x[3:], atol=1e-9)
    np.testing.assert_allclose(corrected.covariance[np.ix_(rows, rows)], P, atol=1e-12)


@given(transforms())
def test_a_precise_measurement_is_adopted(T: Float64) -> None:
    near = T @ se3.exp(np.array([0.003, -0.002, 0.001, 0.002, 0.001, -0.003]))
    corrected = moving(np.zeros(6), T).corrected(near, 1e12 * np.eye(6))
    np.testing.assert_allclose(corrected.T_track_camera, near, atol=1e-6)


@given(transforms())
def test_a_vague_measurement_changes_hardly_anything(T: Float64) -> None:
    far = T @ se3.exp(np.array([0.3, -0.2, 0.1, 0.2, 0.1, -0.3]))
    motion = moving(np.zeros(6), T)
    corrected = motion.corrected(far, 1e-4 * np.eye(6))
    np.testing.assert_allclose(corrected.T_track_camera, T, atol=1e-6)
    np.testing.assert_allclose(corrected.covariance, motion.covariance, rtol=1e-3, atol=1e-9)


def test_a_pose_says_nothing_of_a_direction_in_which_it_was_not_measured() -> None:
    """However often: the camera goes on as predicted, and how far is as uncertain as ever."""
    motion = free = moving(np.array([0, 0, 0.5, 0, 0, 0]))
    information = np.diag([1e6, 1e6, 0.0, 1e6, 1e6, 1e6])
    for i in range(1, 31):
        predicted = motion.predicted(motion.stamp_ns + PERIOD_NS, CONFIG)
        elsewhere = predicted.T_track_camera @ se3.exp(np.array([0, 0, 0.1 * i, 0, 0, 0]))
        motion = predicted.corrected(elsewhere, information)
        free = free.predicted(free.stamp_ns + PERIOD_NS, CONFIG)
    np.testing.assert_allclose(motion.T_track_camera, free.T_track_camera, atol=1e-9)
    np.testing.assert_allclose(motion.covariance[2, 2], free.covariance[2, 2], rtol=1e-6)
    assert motion.covariance[0, 0] < 1e-5 < free.covariance[0, 0]


def test_the_pose_of_a_pushed_camera_follows_the_measurement() -> None:
    motion = moving(np.zeros(6))
    pushed = se3.exp(np.array([0.8, 0, 0.3, 0, 0.5, 0]))
    corrected = motion.corrected(pushed, 1e5 * np.eye(6))
    off = se3.inverse(pushed) @ corrected.T_track_camera
    assert np.linalg.norm(off[:3, 3]) < 0.01
    assert se3.rotation_angle(off) < 0.01


def test_of_a_camera_that_shakes_for_seconds_no_variance_becomes_negative() -> None:
    rng = np.random.default_rng(0)
    motion = Motion.start(0, np.eye(4))
    for i in range(1, 300):
        way = np.array([0.03, -0.02, 0.02, 0.05, 0.04, -0.05]) * (1 + rng.normal(scale=0.3, size=6))
        shaken = se3.exp(way if i % 2 else -way)
        motion = motion.predicted(i * PERIOD_NS, CONFIG).corrected(shaken, 1e4 * np.eye(6))
        assert np.linalg.eigvalsh(motion.covariance)[0] > 0
        np.testing.assert_allclose(motion.covariance, motion.covariance.T, rtol=1e-9)


@given(st.sampled_from([PERIOD_S, 1.0, 60.0, 3600.0]), st.sampled_from([1e-4, 1e-3, 1e-2]))
def test_after_relocalisation_the_covariance_is_that_of_the_measurement_whatever_the_gap(
    seconds: float, sigma: float
) -> None:
    motion = Motion.start(0, np.eye(4)).predicted(round(seconds * NANOSECONDS), CONFIG)
    corrected = motion.corrected(se3.exp(np.full(6, 0.01)), np.eye(6) / sigma**2)
    pose = np.linalg.eigvalsh(corrected.covariance[:6, :6])
    assert 0.5 * sigma**2 < pose.min() <= pose.max() < 1.001 * sigma**2
    assert np.linalg.eigvalsh(corrected.covariance[6:, 6:]).min() > 0
    np.testing.assert_allclose(corrected.covariance, corrected.covariance.T, rtol=1e-6)


@given(SEEDS)
@settings(max_examples=10)
def test_errors_are_consistent_with_the_covariance_if_the_model_holds(seed: int) -> None:
    """Poses with noise, of a camera whose velocity changes at random as the filter assumes."""
    rng = np.random.default_rng(seed)
    sigma, steps = 0.005, 150
    velocity = rng.normal(0, 0.5, 6)
    T = np.eye(4)
    motion = Motion.start(0, T)
    squares = []
    for i in range(1, steps + 1):
        velocity = velocity + rng.normal(0, ACCELERATION) * PERIOD_S
        T = T @ se3.exp(velocity * PERIOD_S)
        velocity = velocity + rng.normal(0, ACCELERATION) * PERIOD_S / 2
        measured = T @ se3.exp(rng.normal(0, sigma, 6))
        predicted = motion.predicted(i * PERIOD_NS, CONFIG)
        motion = predicted.corrected(measured, np.eye(6) / sigma**2)
        off = se3.log(se3.inverse(motion.T_track_camera) @ T)
        error = np.concatenate([off, velocity - motion.twist])
        squares.append(error @ np.linalg.solve(motion.covariance, error))
    # chi-square of 12 degrees of freedom a step; steps share their errors over a tenth of them
    low, high = chi2.ppf([1e-6, 1 - 1e-6], 12 * steps / 10) / (12 * steps / 10)
    assert low < np.mean(squares[10:]) / 12 < high


def velocity_error(seconds: float, *, knows_of_it: bool) -> float:
    """Of a camera at constant velocity whose residuals see it some seconds after its poses are.

    A pose that is refined with a wrong velocity is wrong by the way in that time.
    """
    rng = np.random.default_rng(0)
    motion, errors = moving(np.zeros(6)), []
    for i in range(1, 120):
        predicted = motion.predicted(i * PERIOD_NS, CONFIG)
        used = Distortion(predicted.twist, seconds * np.eye(6))
        noise = rng.normal(0, 1e-3, 6)
        wrong_by = -used.seconds @ (used.twist - VELOCITY) + noise
        measured = se3.exp(VELOCITY * PERIOD_S * i) @ se3.exp(wrong_by)
        motion = predicted.corrected(measured, 1e6 * np.eye(6), used if knows_of_it else None)
        errors.append(motion.twist - VELOCITY)
    return float(np.sqrt(np.mean(np.square(errors[30:]))))


@pytest.mark.parametrize("seconds", [-PERIOD_S, PERIOD_S])
def test_depth_that_is_late_or_early_does_not_make_the_velocity_swing(seconds: float) -> None:
    error = velocity_error(seconds, knows_of_it=True)
    assert error < 0.03
    # as it does where the measured pose is believed
    assert velocity_error(seconds, knows_of_it=False) > 3 * error


@given(SEEDS)
def test_a_measured_velocity_is_weighted_as_in_the_kalman_filter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    predicted = moving(rng.normal(0, 0.5, 6)).predicted(PERIOD_NS, CONFIG)
    R = np.diag(rng.uniform(1e-3, 1.0, 6))
    expected = predicted.covariance[6:, 6:] + R
    seen = predicted.twist + 0.5 * rng.multivariate_normal(np.zeros(6), expected)
    gain = predicted.covariance[:, 6:] @ np.linalg.inv(expected)
    change = gain @ (seen - predicted.twist)
    corrected = predicted.corrected_by_twist(seen, R)
    np.testing.assert_allclose(corrected.twist, predicted.twist + change[6:], atol=1e-12)
    off = se3.log(se3.inverse(predicted.T_track_camera) @ corrected.T_track_camera)
    np.testing.assert_allclose(off, change[:6], atol=1e-9)
    left = predicted.covariance - gain @ predicted.covariance[6:]
    np.testing.assert_allclose(corrected.covariance, left, atol=1e-12)


@pytest.mark.parametrize("forward", [5.0, np.nan])
def test_an_impossible_velocity_is_rejected(forward: float) -> None:
    predicted = moving(np.zeros(6)).predicted(PERIOD_NS, CONFIG)
    seen = np.array([0, 0, forward, 0, 0, 0])
    assert predicted.corrected_by_twist(seen, np.eye(6) * 1e-2) is predicted


def test_noisy_poses_of_a_smooth_motion_are_smoothed() -> None:
    rng = np.random.default_rng(0)
    sigma = 0.01
    config = MotionConfig(acceleration=0.5, angular_acceleration=0.5)
    motion = Motion.start(0, np.eye(4))
    noise, left = [], []
    for i in range(1, 120):
        T = se3.exp(np.array([0.3, 0, 0.2, 0, 0.3, 0]) * i * PERIOD_S)
        measured = T @ se3.exp(rng.normal(0, sigma, 6))
        predicted = motion.predicted(i * PERIOD_NS, config)
        motion = predicted.corrected(measured, np.eye(6) / sigma**2)
        noise.append(np.linalg.norm((measured - T)[:3, 3]))
        left.append(np.linalg.norm((motion.T_track_camera - T)[:3, 3]))
    assert np.mean(left[30:]) < 0.6 * np.mean(noise[30:])
    assert motion.twist == pytest.approx([0.3, 0, 0.2, 0, 0.3, 0], abs=0.1)


def test_a_camera_relocalised_elsewhere_gets_no_velocity_from_the_jump() -> None:
    """Half a turn in a thirtieth of a second is no motion."""
    motion = Motion.start(0, np.eye(4)).predicted(NANOSECONDS // 30, MotionConfig())
    elsewhere = se3.exp(np.array([0.0, 0, 0, 0, 0, np.pi]))
    found = motion.corrected(elsewhere, 1e6 * np.eye(6))
    np.testing.assert_allclose(found.T_track_camera, elsewhere, atol=1e-3)
    np.testing.assert_array_equal(found.twist, 0.0)
    assert (np.diag(found.covariance)[6:] >= 1.0).all()
    assert np.linalg.eigvalsh(found.covariance).min() > 0


@pytest.mark.parametrize(
    ("way", "frames", "reached"),
    [
        ([0.1, 0, 0, 0, 0, 0], 1, True),  # pushed
        ([0, 0, 0, 0.1, 0, 0], 1, True),
        ([0.5, 0, 0, 0, 0, 0], 1, False),  # farther than anybody goes in a thirtieth of a second
        ([0, 0, 0, 1.0, 0, 0], 1, False),
        ([0.5, 0, 0, 0, 0, 0], 10, True),  # not seen for a third of a second
        ([0, 0, 0, 3.0, 0, 0], 60, True),
        ([0, 0, 100.0, 0, 0, 0], 60, False),
    ],
)
def test_the_reach_of_a_camera_is_limited(way: list[float], frames: int, reached: bool) -> None:
    last = moving(np.array([0.2, 0, 0, 0, 0.3, 0]))
    predicted = last.predicted(frames * PERIOD_NS, CONFIG)
    there = predicted.T_track_camera @ se3.exp(np.array(way))
    assert predicted.reaches(there) == reached


def test_the_prediction_is_always_within_reach() -> None:
    last = moving(np.array([0.2, -1.0, 0, 0, 0.3, 2.0]))
    for frames in (1, 5, 100):
        predicted = last.predicted(frames * PERIOD_NS, CONFIG)
        assert predicted.reaches(predicted.T_track_camera)


def test_a_way_that_another_odometry_measured_gives_pose_and_velocity() -> None:
    last = moving(np.array([0.1, 0, 0, 0, 0, 0.2]), at(np.array([1.0, 2, 3])))
    predicted = last.predicted(last.stamp_ns + NANOSECONDS // 10, CONFIG)
    way = se3.exp(np.array([0.0, 0.03, 0, 0.01, 0, 0]))
    along = predicted.along(way, last)
    np.testing.assert_allclose(along.T_track_camera, last.T_track_camera @ way)
    np.testing.assert_allclose(along.twist, [0, 0.3, 0, 0.1, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(along.covariance, predicted.covariance)


def test_a_way_that_no_camera_goes_is_not_taken() -> None:
    last = moving(np.zeros(6))
    predicted = last.predicted(last.stamp_ns + NANOSECONDS // 10, CONFIG)
    assert predicted.along(at(np.array([0.6, 0, 0])), last) is predicted


ALONG_X = np.diag([1.0, 0, 0, 0, 0, 0])


def test_a_velocity_that_is_not_measured_fades_to_a_third_within_half_a_second() -> None:
    motion: Motion = moving(np.array([0.5, 0.2, 0, 0, 0, 1.0]))
    for i in range(1, 16):
        motion = motion.predicted(i * PERIOD_NS, CONFIG).slowed(ALONG_X)
    assert motion.twist[0] == pytest.approx(0.5 / np.e, rel=1e-3)
    np.testing.assert_allclose(motion.twist[1:], [0.2, 0, 0, 0, 1.0], atol=1e-12)


@given(SEEDS)
def test_a_decoupled_part_stays_where_it_is_while_the_rest_is_corrected(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(12, 12))
    motion = replace(moving(np.array([0.5, 0, 0, 0, 0, 0])), covariance=root @ root.T)
    predicted = motion.predicted(PERIOD_NS, CONFIG)
    measured = predicted.T_track_camera @ se3.exp(np.array([0, 0.01, 0.02, 0.01, 0, 0]))
    information = 1e6 * (np.eye(6) - ALONG_X)
    corrected = predicted.decoupled(ALONG_X).corrected(measured, information)
    error = se3.log(se3.inverse(predicted.T_track_camera) @ corrected.T_track_camera)
    assert abs(error[0]) < 1e-3 < abs(error[2])
    assert corrected.twist[0] == pytest.approx(predicted.twist[0])
    # without that, its covariance with the rest carries it along
    coupled = predicted.corrected(measured, information)
    assert coupled.twist[0] != pytest.approx(predicted.twist[0])
    np.testing.assert_allclose(
        predicted.decoupled(ALONG_X).covariance[0, 0], predicted.covariance[0, 0]
    )


def test_at_its_own_keyframe_a_pose_is_exact_and_its_velocity_as_uncertain_as_before() -> None:
    motion = moving(np.array([0.5, 0, 0, 0, 0, 0]))
    exact = motion.at_own_keyframe()
    np.testing.assert_array_equal(exact.pose_covariance, np.zeros((6, 6)))
    np.testing.assert_array_equal(exact.covariance[6:, 6:], motion.covariance[6:, 6:])
    np.testing.assert_array_equal(exact.T_track_camera, motion.T_track_camera)
