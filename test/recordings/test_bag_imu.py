"""The samples of an IMU come out of a bag in the axes of the camera, or not at all."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from raycast_room.imu import BMI055, simulated_imu
from rigs.bags import Recorded, make_frames, recorded, write_rosbag2
from rigs.room import room_frame, true_pose
from rosbags.typesys import Stores, get_typestore

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.replay.replay import replay
from rgbd_glue_ros.experiments.replay.result_names import METRICS
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages import making
from rgbd_glue_ros.parameters import InputConfig, load_preset
from rgbd_glue_ros.recordings import Topics, imu_of, open_recording
from rgbd_glue_ros.recordings.bag.recording import BagRecording
from rgbd_glue_ros.types import NANOSECONDS, Float64, ImuSamples, ImuUse

TYPES = get_typestore(Stores.ROS2_JAZZY).types
CAMERA_FRAME, IMU_FRAME = "camera_optical", "imu_link"
TOPIC = "/camera/imu"
T_CAMERA_IMU = se3.exp(np.array([0.01, 0, 0, 0, np.pi / 2, 0]))
SAMPLES = ImuSamples(
    np.arange(1, 21, dtype=np.int64) * 5_000_000,
    np.random.default_rng(0).normal(size=(20, 3)),
    np.random.default_rng(1).normal(size=(20, 3)),
)


def imu_messages(
    samples: ImuSamples, frame_id: str = IMU_FRAME, topic: str = TOPIC
) -> list[Recorded]:
    return [
        Recorded(topic, "sensor_msgs/msg/Imu", int(stamp), making.imu(samples, i, frame_id))
        for i, stamp in enumerate(samples.stamps_ns)
    ]


def place(T: Float64) -> Recorded:
    """What robot_state_publisher says of the IMU."""
    kinds: Any = TYPES
    transform = kinds["geometry_msgs/msg/Transform"](
        kinds["geometry_msgs/msg/Vector3"](*T[:3, 3].tolist()),
        kinds["geometry_msgs/msg/Quaternion"](*se3.quaternion(T).tolist()),
    )
    stamped = kinds["geometry_msgs/msg/TransformStamped"](
        making.header(0, CAMERA_FRAME), IMU_FRAME, transform
    )
    message = kinds["tf2_msgs/msg/TFMessage"]([stamped])
    return Recorded("/tf_static", "tf2_msgs/msg/TFMessage", 0, message)


def bag(folder: Path, *messages: Recorded) -> Path:
    return write_rosbag2(folder / "bag", [*recorded(make_frames(2)), *messages])


def assert_samples(got: ImuSamples | None, R: Float64) -> None:
    assert got is not None
    np.testing.assert_array_equal(got.stamps_ns, SAMPLES.stamps_ns)
    for name in ("angular_velocity", "linear_acceleration"):
        np.testing.assert_allclose(getattr(got, name), getattr(SAMPLES, name) @ R.T, atol=1e-12)


@pytest.mark.parametrize(
    ("frame_id", "transforms", "inputs", "R"),
    [
        (IMU_FRAME, [place(T_CAMERA_IMU)], InputConfig(), T_CAMERA_IMU[:3, :3]),
        (CAMERA_FRAME, [], InputConfig(), np.eye(3)),
        (IMU_FRAME, [], InputConfig(imu_pose=f"0 0 0 0 {np.pi / 2} 0"), T_CAMERA_IMU[:3, :3]),
    ],
    ids=["from /tf_static", "in the camera's frame", "as given"],
)
def test_samples_are_turned_into_the_cameras_axes(
    tmp_path: Path, frame_id: str, transforms: list[Recorded], inputs: InputConfig, R: Float64
) -> None:
    path = bag(tmp_path, *imu_messages(SAMPLES, frame_id), *transforms)
    with BagRecording(path, inputs=inputs) as recording:
        assert_samples(recording.imu, R)
    with open_recording(path, inputs=InputConfig(imu_pose=inputs.imu_pose, max_width=32)) as small:
        assert_samples(imu_of(small), R)


def test_an_imu_whose_place_is_not_told_is_left_out_and_that_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with BagRecording(bag(tmp_path, *imu_messages(SAMPLES))) as recording:
        assert recording.imu is None
    assert "imu_pose" in caplog.text


@pytest.mark.parametrize(
    ("wanted", "is_taken"), [(None, False), (TOPIC, True), ("", False), ("/base/imu", True)]
)
def test_of_several_imus_one_has_to_be_given(
    tmp_path: Path, wanted: str | None, is_taken: bool, caplog: pytest.LogCaptureFixture
) -> None:
    both = (*imu_messages(SAMPLES), *imu_messages(SAMPLES, topic="/base/imu"))
    with BagRecording(bag(tmp_path, *both, place(T_CAMERA_IMU)), Topics(imu=wanted)) as recording:
        # the camera's own namespace comes first
        assert (recording.imu is not None) == (is_taken or wanted is None)
    near = (*imu_messages(SAMPLES), *imu_messages(SAMPLES, topic="/camera/imu_raw"))
    with BagRecording(bag(tmp_path / "near", *near), Topics(imu="")) as recording:
        assert recording.imu is None
    with BagRecording(tmp_path / "near" / "bag") as recording:
        assert recording.imu is None
    assert "--imu-topic" in caplog.text


def test_an_imu_topic_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no topic /imu of an IMU"):
        BagRecording(bag(tmp_path, *imu_messages(SAMPLES)), Topics(imu="/imu"))


def unstamped(recorded_message: Recorded) -> Recorded:
    message: Any = recorded_message.message
    head = making.header(0, message.header.frame_id)
    return replace(recorded_message, message=replace(message, header=head))


@pytest.mark.parametrize("stamps", ["header", "receipt"])
def test_samples_are_of_the_clock_of_images_that_have_no_stamp(tmp_path: Path, stamps: str) -> None:
    images = [unstamped(message) for message in recorded(make_frames(3))]
    later = [replace(m, stamp_ns=m.stamp_ns + NANOSECONDS) for m in imu_messages(SAMPLES)]
    path = write_rosbag2(tmp_path / "bag", [*images, *later])
    with BagRecording(path, inputs=InputConfig(stamps=stamps, imu_pose="0 0 0 0 0 0")) as recording:
        assert recording.imu is not None
        np.testing.assert_array_equal(recording.imu.stamps_ns, SAMPLES.stamps_ns + NANOSECONDS)


def test_a_bag_without_an_imu_has_none(tmp_path: Path) -> None:
    with BagRecording(bag(tmp_path)) as recording:
        assert recording.imu is None


@pytest.mark.slow
def test_a_replay_turns_with_the_imu_of_its_bag(tmp_path: Path) -> None:
    frames = [room_frame(i / 10) for i in range(9)]
    samples = simulated_imu(true_pose, 0.0, 1.0, BMI055)
    images: list[Any] = recorded(frames)
    path = write_rosbag2(tmp_path / "bag", [*images, *imu_messages(samples, frames[0].frame_id)])
    inputs = InputConfig(imu_pose="0 0 0 0 0 0")
    with open_recording(path, inputs=inputs) as recording:
        run = replay(recording, load_preset("live"), tmp_path / "out")
    assert len(run.trajectory) == len(frames)
    learnt = run.imu
    assert learnt is not None
    assert learnt.use is ImuUse.TURNS
    off = np.linalg.norm(learnt.bias - BMI055.bias)
    assert off < 0.5 * np.linalg.norm(BMI055.bias)
    metrics = json.loads((tmp_path / "out" / METRICS).read_text())
    assert metrics["imu"]["use"] == "turns and gravity"
    assert metrics["imu"]["bias_rad_s"] == pytest.approx(learnt.bias)
    up = metrics["up"]
    # at the first frame there was one sample of the moving sensor
    true_up = true_pose(0.0)[:3, :3].T @ [0, 0, 1]
    assert np.degrees(np.arccos(up @ true_up)) < 10


@pytest.mark.slow
def test_a_replay_says_when_a_gyroscope_turns_otherwise_than_the_images(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frames = [room_frame(i / 10) for i in range(30)]
    moving = simulated_imu(true_pose, 0.0, 3.0, BMI055)
    still = replace(moving, angular_velocity=np.zeros_like(moving.angular_velocity))
    images: list[Any] = recorded(frames)
    path = write_rosbag2(tmp_path / "bag", [*images, *imu_messages(still, frames[0].frame_id)])
    with open_recording(path, inputs=InputConfig(imu_pose="0 0 0 0 0 0")) as recording:
        replay(recording, load_preset("live"), tmp_path / "out")
    assert "imu: the gyroscope disagrees with the images" in caplog.text
