"""Samples of an IMU are what its messages say, and nothing where they say nothing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages import fields, making
from rgbd_glue_ros.messages.imu import ImuReading, imu_reading, imu_samples
from rgbd_glue_ros.types import ImuSamples

SAMPLES = ImuSamples(
    np.array([10, 20, 30], np.int64),
    np.array([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0], [np.nan] * 3]),
    np.array([[0.0, 0.0, 9.8], [np.nan] * 3, [1.0, 2.0, 3.0]]),
)


def test_samples_written_to_messages_are_read_back() -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    readings = []
    for index in range(len(SAMPLES)):
        message = making.imu(SAMPLES, index, "imu_link")
        kind = "sensor_msgs/msg/Imu"
        read: Any = store.deserialize_cdr(store.serialize_cdr(message, kind), kind)
        assert read.header.frame_id == "imu_link"
        readings.append(imu_reading(read, int(SAMPLES.stamps_ns[index]), "imu"))
    got = imu_samples(readings)
    for name in ("stamps_ns", "angular_velocity", "linear_acceleration"):
        np.testing.assert_array_equal(getattr(got, name), getattr(SAMPLES, name))


def test_zero_acceleration_means_that_there_is_no_accelerometer() -> None:
    zero = fields.Vector3(0.0, 0.0, 0.0)
    message = replace(making.imu(SAMPLES, 0, ""), linear_acceleration=zero)
    assert np.isnan(imu_reading(message, 0, "imu").linear_acceleration).all()


def test_measurements_that_are_not_finite_are_refused() -> None:
    broken = fields.Vector3(0.0, float("nan"), 0.0)
    message = replace(making.imu(SAMPLES, 0, ""), angular_velocity=broken)
    with pytest.raises(InputError, match="imu: a measurement is not finite"):
        imu_reading(message, 0, "imu")


def test_a_message_of_another_type_is_refused() -> None:
    image = making.header(0, "")
    with pytest.raises(InputError, match="has the type Header"):
        imu_reading(image, 0, "imu")  # type: ignore[arg-type]


def test_readings_are_sorted_and_of_equal_stamps_the_first_is_kept() -> None:
    readings = [
        ImuReading(stamp, np.full(3, float(value)), np.full(3, float(value)))
        for stamp, value in ((30, 1), (10, 2), (30, 3), (20, 4))
    ]
    samples = imu_samples(readings)
    np.testing.assert_array_equal(samples.stamps_ns, [10, 20, 30])
    np.testing.assert_array_equal(samples.angular_velocity[:, 0], [2, 4, 1])
    assert len(imu_samples([])) == 0


def test_samples_are_rotated_to_other_axes_and_selected_by_time() -> None:
    quarter = se3.exp(np.array([0, 0, 0, 0, 0, np.pi / 2]))[:3, :3]
    turned = SAMPLES.rotated(quarter)
    np.testing.assert_allclose(turned.angular_velocity[0], [-0.2, 0.1, 0.3], atol=1e-15)
    np.testing.assert_array_equal(SAMPLES.between(10, 20).stamps_ns, [10, 20])
    np.testing.assert_array_equal(SAMPLES.between(11, 29).stamps_ns, [20])


def test_of_repeated_samples_the_first_are_kept() -> None:
    joined = SAMPLES.between(0, 20).merged_with(SAMPLES)
    np.testing.assert_array_equal(joined.stamps_ns, SAMPLES.stamps_ns)


def test_samples_that_arrive_out_of_order_are_put_in_order() -> None:
    first_and_last = SAMPLES.between(10, 10).merged_with(SAMPLES.between(30, 30))
    joined = first_and_last.merged_with(SAMPLES.between(20, 20))
    for name in ("stamps_ns", "angular_velocity", "linear_acceleration"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(SAMPLES, name))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"stamps_ns": np.zeros(3)}, "stamps_ns: is float64"),
        ({"stamps_ns": np.array([1, 3, 3], np.int64)}, "stamps_ns: does not increase"),
        ({"angular_velocity": np.zeros((2, 3))}, "angular_velocity: is float64"),
        ({"linear_acceleration": np.zeros((3, 3), np.float32)}, "linear_acceleration: is float32"),
    ],
)
def test_arrays_that_are_not_samples_are_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        replace(SAMPLES, **change)
