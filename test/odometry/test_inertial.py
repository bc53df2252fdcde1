"""With an IMU the camera is expected where it turned to; without, all is as it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from raycast_room.imu import BMI055, ImuErrors, simulated_imu
from rigs.room import room_frame, room_view, true_pose, true_twist

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.gyroscope import Gyroscope
from rgbd_glue_ros.odometry.inertial import Inertial
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.odometry.pose_refinement import PoseEstimate
from rgbd_glue_ros.parameters import Config, MotionConfig, load_preset
from rgbd_glue_ros.refinement.gauss_newton import evaluate_pose
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.types import NANOSECONDS, ImuSamples

CONFIG = MotionConfig()
PERIOD_NS = NANOSECONDS // 10
PERIOD_S = 0.1
TWIST = np.array([0.3, -0.2, 0.4, 0.5, -0.3, 0.2])
MOVING = Motion(0, np.eye(4), TWIST, np.diag([1e-4] * 6 + [1e-2] * 6))


def turning(angular_velocity: list[float]) -> ImuSamples:
    stamps = np.arange(0, PERIOD_NS + 1, 5_000_000, dtype=np.int64)
    return ImuSamples(
        stamps, np.tile(angular_velocity, (len(stamps), 1)), np.full((len(stamps), 3), np.nan)
    )


def assert_same_bits(a: Motion, b: Motion) -> None:
    for name in ("T_track_camera", "twist", "covariance"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


@pytest.mark.parametrize(
    "inertial",
    [
        Inertial(),
        Inertial(turning([1.0, 2.0, 3.0]).between(0, PERIOD_NS // 3)),
        Inertial(turning([1.0, 2.0, 3.0]), replace(Gyroscope.start(), doubt=0.6)),
    ],
    ids=["no samples", "a gap", "a gyroscope that disagrees with the images"],
)
def test_without_a_gyroscope_turn_the_prediction_is_bitwise_the_same(inertial: Inertial) -> None:
    assert_same_bits(
        inertial.predicted(MOVING, PERIOD_NS, CONFIG), MOVING.predicted(PERIOD_NS, CONFIG)
    )


def test_the_predicted_rotation_is_that_of_the_gyroscope() -> None:
    predicted = Inertial(turning([-1.0, 2.0, 0.5])).predicted(MOVING, PERIOD_NS, CONFIG)
    rotation = se3.rotation_vector(predicted.T_track_camera)
    np.testing.assert_allclose(rotation, [-0.1, 0.2, 0.05], atol=1e-12)
    np.testing.assert_allclose(predicted.twist, [0.3, -0.2, 0.4, -1.0, 2.0, 0.5], atol=1e-12)


def test_a_gyroscope_that_confirms_the_prediction_only_makes_the_velocity_more_certain() -> None:
    plain = MOVING.predicted(PERIOD_NS, CONFIG)
    predicted = Inertial(turning([0.5, -0.3, 0.2])).predicted(MOVING, PERIOD_NS, CONFIG)
    np.testing.assert_allclose(predicted.T_track_camera, plain.T_track_camera, atol=1e-12)
    np.testing.assert_allclose(predicted.twist, plain.twist, atol=1e-12)
    np.testing.assert_array_equal(predicted.covariance[:9, :9], plain.covariance[:9, :9])
    assert (np.diag(predicted.covariance)[9:] < 0.3 * np.diag(plain.covariance)[9:]).all()
    assert (np.linalg.eigvalsh(predicted.covariance) > 0).all()


def test_samples_that_no_frame_needs_are_discarded() -> None:
    stamps = np.arange(0, 120 * NANOSECONDS, NANOSECONDS // 10, dtype=np.int64)
    samples = ImuSamples(stamps, np.zeros((len(stamps), 3)), np.zeros((len(stamps), 3)))
    later = Inertial(samples).at_frame(100 * NANOSECONDS)
    assert len(later.samples) < 350
    assert later.samples.stamps_ns[-1] == stamps[-1]


def test_a_stamp_in_the_future_does_not_keep_later_samples_from_being_used() -> None:
    velocity, hour_ns = [-1.0, 2.0, 0.5], 3600 * NANOSECONDS
    wrong = replace(turning(velocity).between(0, 0), stamps_ns=np.array([hour_ns], np.int64))
    good = turning(velocity)
    inertial = Inertial(good.between(0, 0)).with_samples(wrong).with_samples(good)
    without = Inertial(good).predicted(MOVING, PERIOD_NS, CONFIG)
    assert_same_bits(inertial.predicted(MOVING, PERIOD_NS, CONFIG), without)


def test_the_accelerometer_gives_the_upward_direction_while_the_camera_turns() -> None:
    samples = simulated_imu(true_pose, -1.0, 1.0, ImuErrors())
    up = Inertial(samples).up(NANOSECONDS // 2)
    assert up is not None
    true_up = true_pose(0.5)[:3, :3].T @ [0, 0, 1]
    # what is left is how the hand's velocity changes within half a second
    assert np.degrees(np.arccos(up @ true_up)) < 6.0


@pytest.mark.parametrize(
    "acceleration", [0.0, 1.0, 30.0], ids=["falling", "in units of g", "being thrown"]
)
def test_accelerations_other_than_gravity_give_no_upward_direction(acceleration: float) -> None:
    still = turning([0.0, 0.0, 0.0])
    pull = np.full_like(still.linear_acceleration, 0.0)
    pull[:, 1] = -acceleration
    samples = ImuSamples(still.stamps_ns, still.angular_velocity, pull)
    assert Inertial(samples).up(PERIOD_NS) is None


def test_where_poses_start_anew_the_gyroscope_is_not_compared_across() -> None:
    samples = simulated_imu(true_pose, -0.5, 2.0, BMI055)
    view = room_view(0.0)
    model = model_of(view, 8)
    seen = evaluate_pose(np.eye(4), RefinementProblem(model, view, Config().refine))
    turned = se3.exp(np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0]))
    elsewhere = PoseEstimate(replace(seen, T_model_source=turned))
    before = Inertial(samples).after_pose(0, PoseEstimate(seen), 100.0)
    assert before.after_pose(PERIOD_NS, elsewhere, 100.0).gyroscope is not before.gyroscope
    anew = before.start_anew().after_pose(PERIOD_NS, elsewhere, 100.0)
    assert anew.gyroscope is before.gyroscope


@pytest.mark.slow
def test_the_odometry_turns_with_the_imu_and_learns_its_bias() -> None:
    samples = simulated_imu(true_pose, -0.5, 2.0, BMI055)
    off: dict[bool, list[float]] = {True: [], False: []}
    for has_imu, errors in off.items():
        with Odometry(load_preset("live")) as odometry:
            if has_imu:
                odometry.add_imu(samples)
            for i in range(9):
                estimate = odometry.process(room_frame(i / 10))
                if i > 1 and estimate.twist is not None:
                    errors.append(
                        float(np.linalg.norm(estimate.twist[3:] - true_twist(i / 10)[3:]))
                    )
            before, after = (
                np.linalg.norm(np.subtract(BMI055.bias, b))
                for b in (0.0, odometry.imu_calibration.bias)
            )
            assert after < before / 2 if has_imu else after == before
    assert len(off[True]) == len(off[False]) == 7
    assert np.mean(off[True]) < np.mean(off[False]) / 3
