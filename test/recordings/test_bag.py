from __future__ import annotations

import logging
import shutil
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rigs.bags import (
    CAMERA,
    CODECS,
    COLOR,
    DEPTH,
    INFO,
    PERIOD_NS,
    START_NS,
    Recorded,
    assert_same_frame,
    make_frames,
    recorded,
    write_rosbag1,
    write_rosbag2,
)
from rigs.layouts import APPLE_DOUBLE
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_typestore

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages.making import header, pose_stamped
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings import open_recording, recordings
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.recordings.bag.recording import BagRecording, Topics
from rgbd_glue_ros.recordings.left_out import LeftOut

FRAMES = make_frames(8)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_rosbag2(tmp_path_factory.mktemp("bags") / "bag", recorded(FRAMES))


def poses_on(topic: str, count: int, message_type: str = "PoseStamped") -> list[Recorded]:
    """True poses along a curve."""
    rows = []
    for i in range(count):
        stamp = START_NS + i * PERIOD_NS
        pose = pose_stamped(_truth(i), header(stamp, "world"))
        rows.append(Recorded(topic, f"geometry_msgs/msg/{message_type}", stamp, pose))
    return rows


def _truth(i: int) -> Any:
    return se3.exp(0.1 * i * np.array([1.0, 2.0, 3.0, 0.3, -0.2, 0.1]))


def _empty_folder(path: Path) -> Path:
    (path / "empty").mkdir()
    return path / "empty"


def _file(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize(
    ("storage", "compression"),
    [
        (StoragePlugin.MCAP, CompressionMode.NONE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
    ],
)
def test_frames_come_back_from_every_kind_of_rosbag2(
    storage: StoragePlugin, compression: CompressionMode, codec: str, tmp_path: Path
) -> None:
    messages = recorded(FRAMES, CODECS[codec])
    folder = write_rosbag2(tmp_path / "kitchen", messages, storage, compression)
    with open_recording(folder) as sequence:
        assert sequence.name == "kitchen"
        assert sequence.frame_count == len(FRAMES)
        for frame, original in zip(sequence, FRAMES, strict=True):
            assert_same_frame(frame, original, CODECS[codec])


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize("compression", ["", "BZ2", "LZ4"])
def test_frames_come_back_from_a_ros1_bag(compression: str, codec: str, tmp_path: Path) -> None:
    messages = [*recorded(FRAMES, CODECS[codec]), *poses_on("/ground_truth", 3)]
    file = write_rosbag1(tmp_path / "kitchen.bag", messages, compression)
    with open_recording(file) as sequence:
        assert sequence.name == "kitchen"
        for frame, original in zip(sequence, FRAMES, strict=True):
            assert_same_frame(frame, original, CODECS[codec])
        truth = sequence.ground_truth
    assert truth is not None
    assert truth.poses == pytest.approx(np.stack([_truth(i) for i in range(3)]))


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_the_storage_file_alone_or_a_folder_without_metadata_will_do(
    storage: StoragePlugin, tmp_path: Path
) -> None:
    folder = write_rosbag2(tmp_path / "bag", recorded(FRAMES), storage)
    (folder / "metadata.yaml").unlink()
    (file,) = folder.iterdir()
    for path in (file, folder):
        with BagRecording(path) as sequence:
            assert len(list(sequence)) == len(FRAMES)


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("has_metadata", [True, False])
def test_what_macos_leaves_beside_the_files_of_a_bag_is_no_part_of_it(
    parts: int, has_metadata: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    messages = recorded(FRAMES)
    for i, some in enumerate(np.array_split(np.arange(len(messages)), parts)):
        part = write_rosbag2(tmp_path / f"run_{i}", [messages[j] for j in some])
        (part / f"run_{i}.mcap").rename(folder / f"run_{i}.mcap")
        if has_metadata:
            (part / "metadata.yaml").replace(folder / "metadata.yaml")
        shutil.rmtree(part)
    for path in [*folder.iterdir()]:
        path.with_name(f"._{path.name}").write_bytes(APPLE_DOUBLE)
    assert recordings([tmp_path]) == [folder]
    with open_recording(folder) as recording:
        assert len(list(recording)) == len(FRAMES)
    assert not caplog.messages


def test_of_a_bag_with_a_pointer_of_git_lfs_for_a_part_the_others_are_read(
    tmp_path: Path,
) -> None:
    folder = write_rosbag2(tmp_path / "run", recorded(FRAMES))
    (folder / "run.mcap").rename(folder / "run_0.mcap")
    pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a21461\nsize 12345\n"
    (folder / "run_1.mcap").write_text(pointer)
    said = r"run_1\.mcap: it is a pointer of Git LFS in place of the file; what could be read"
    with open_recording(folder) as recording:
        frames = iter(recording)
        assert len([next(frames) for _ in FRAMES]) == len(FRAMES)
        with pytest.raises(InputError, match=said):
            next(frames)


def test_every_iteration_gives_the_same_frames_from_the_beginning(bag: Path) -> None:
    with BagRecording(bag) as sequence:
        for _ in zip(range(3), sequence, strict=False):
            pass
        for frame, original in zip(sequence, FRAMES, strict=True):
            assert_same_frame(frame, original)


def test_infrared_of_ten_bits_is_read_with_its_texture_each_time(tmp_path: Path) -> None:
    messages = recorded(FRAMES)
    counts = [frame.color[..., 0].astype("<u2") * 4 for frame in FRAMES]
    for image, pixels in zip((m for m in messages if m.topic == COLOR), counts, strict=True):
        mono16 = {"encoding": "mono16", "step": 128, "data": pixels.view(np.uint8).ravel()}
        vars(image)["message"] = replace(image.message, **mono16)
    with BagRecording(write_rosbag2(tmp_path / "bag", messages)) as sequence:
        for _ in range(2):
            bits = max(int(pixels.max()).bit_length() for pixels in counts)
            for frame, pixels in zip(sequence, counts, strict=True):
                expected = pixels * (255 / (2**bits - 1))
                assert np.abs(frame.color - expected).max() < 1


def test_chosen_frames_are_those_of_their_numbers(bag: Path) -> None:
    with open_recording(bag) as sequence:
        stamps = [frame.stamp_ns for frame in sequence.select([1, 2, 6, 99])]
    assert stamps == [FRAMES[i].stamp_ns for i in (1, 2, 6)]


@pytest.mark.parametrize(
    ("make", "cause"),
    [
        (lambda p: p / "nothing", "does not exist"),
        (_empty_folder, "is not a bag; looked for metadata.yaml or *.mcap, *.db3, *.bag"),
        (lambda p: write_rosbag2(p / "bag", []), "holds no message: it is empty"),
        (lambda p: _file(p / "x.mcap", b""), "holds no message: it does not start like a bag"),
        (lambda p: _file(p / "x.db3", b"\0" * 999), "holds no message: it does not start like"),
        (lambda p: _file(p / "x.bag", b"#ROSBAG V2.0\n"), "its recorder did not finish it"),
        (lambda p: _file(p / "metadata.yaml", b"{}"), "is not a bag"),
    ],
)
def test_what_is_no_bag_or_an_empty_one_is_refused(make: Any, cause: str, tmp_path: Path) -> None:
    path = make(tmp_path)
    with pytest.raises(InputError) as caught:
        BagRecording(path)
    assert caught.value.where == str(path)
    assert cause in str(caught.value)


def test_ground_truth_is_read_from_poses_transforms_and_odometry(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    types = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    expected = np.stack([_truth(i) for i in range(4)])
    covariance = np.zeros(36)
    for kind in ("PoseStamped", "TransformStamped", "Odometry"):
        rows = poses_on("/mocap/camera", 4)
        for i, row in enumerate(rows):
            head, pose = row.message.header, row.message.pose
            zero = types["Vector3"](0.0, 0.0, 0.0)
            message = {
                "PoseStamped": row.message,
                "TransformStamped": types["TransformStamped"](
                    head, "camera", types["Transform"](pose.position, pose.orientation)
                ),
                "Odometry": types["Odometry"](
                    head,
                    "camera",
                    types["PoseWithCovariance"](pose, covariance),
                    types["TwistWithCovariance"](types["Twist"](zero, zero), covariance),
                ),
            }[kind]
            package = "nav_msgs" if kind == "Odometry" else "geometry_msgs"
            rows[i] = replace(row, type=f"{package}/msg/{kind}", message=message)
        folder = write_rosbag2(tmp_path / kind, [*recorded(FRAMES[:1]), *rows])
        with BagRecording(folder) as sequence:
            truth = sequence.ground_truth
        assert truth is not None
        assert truth.poses == pytest.approx(expected, abs=1e-12)
        assert truth.stamps_ns.tolist() == [row.stamp_ns for row in rows]


def test_a_pose_that_is_not_finite_is_left_out_of_the_ground_truth(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rows = poses_on("/ground_truth/pose", 4)
    bad = rows[1].message
    bad = replace(bad, pose=replace(bad.pose, position=replace(bad.pose.position, x=np.nan)))
    rows[1] = replace(rows[1], message=bad)
    null = rows[2].message
    zeros = replace(null.pose.orientation, x=0.0, y=0.0, z=0.0, w=0.0)
    rows[2] = replace(rows[2], message=replace(null, pose=replace(null.pose, orientation=zeros)))
    folder = write_rosbag2(tmp_path / "bag", [*recorded(FRAMES[:1]), *rows])
    with BagRecording(folder) as sequence:
        truth = sequence.ground_truth
        assert sequence.ground_truth is truth
    assert truth is not None
    assert truth.stamps_ns.tolist() == [rows[0].stamp_ns, rows[3].stamp_ns]
    assert caplog.text.count("/ground_truth/pose: a pose is not finite") == 1


def test_malformed_messages_are_skipped_counted_and_logged_once_per_cause(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    messages = recorded(FRAMES)
    for i in (1, 4):
        color = messages[3 * i]
        cut = replace(color.message, data=color.message.data[: -100 * i])
        messages[3 * i] = replace(color, message=cut)
    with BagRecording(write_rosbag2(tmp_path / "bag", messages)) as sequence:
        stamps = [frame.stamp_ns for frame in sequence]
        assert sequence.skipped == 2
    assert stamps == [f.stamp_ns for i, f in enumerate(FRAMES) if i not in (1, 4)]
    assert [r.levelno for r in caplog.records].count(logging.WARNING) == 2
    assert f"{COLOR}: data are truncated: 9116 bytes instead of 9216" in caplog.text


def test_what_was_skipped_is_counted_though_the_iteration_ends_early(tmp_path: Path) -> None:
    messages = recorded(FRAMES)
    cut = replace(messages[0].message, data=messages[0].message.data[:-100])
    messages[0] = replace(messages[0], message=cut)
    with BagRecording(write_rosbag2(tmp_path / "bag", messages)) as sequence:
        assert next(iter(sequence)).stamp_ns == FRAMES[1].stamp_ns
        assert sequence.skipped == 1
        assert next(sequence.select([len(FRAMES) - 2])).stamp_ns == FRAMES[-1].stamp_ns
        assert sequence.skipped == 1


def test_bytes_that_are_not_of_their_type_are_skipped(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write_rosbag2(tmp_path / "bag", recorded(FRAMES), StoragePlugin.SQLITE3)
    with sqlite3.connect(folder / "bag.db3") as database:
        database.execute("UPDATE messages SET data = x'00010000ff' WHERE id = 4")
    with BagRecording(folder) as sequence:
        assert len(list(sequence)) == len(FRAMES) - 1
        assert sequence.skipped == 1
    assert f"{COLOR}: a message is not a valid sensor_msgs/msg/Image" in caplog.text


def test_a_bag_without_a_single_usable_frame_is_refused_with_the_first_cause_told_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    messages = [
        replace(m, message=replace(m.message, k=np.zeros(9), p=np.zeros(12)))
        if m.topic == INFO
        else m
        for m in recorded(FRAMES)
    ]
    with (
        BagRecording(write_rosbag2(tmp_path / "bag", messages)) as sequence,
        pytest.raises(InputError, match=f"{INFO}: K is all zeros"),
    ):
        list(sequence)
    assert "K is all zeros" not in caplog.text


def test_images_that_never_pair_are_refused_with_their_distance(tmp_path: Path) -> None:
    late = [replace(f, stamp_ns=f.stamp_ns + 25_000_000) for f in FRAMES[:1]]
    messages = [m for m in recorded(FRAMES[:1]) if m.topic != DEPTH]
    messages += [m for m in recorded(late) if m.topic == DEPTH]
    with (
        BagRecording(write_rosbag2(tmp_path / "bag", messages)) as sequence,
        pytest.raises(InputError, match=r"are 25\.0 ms apart at best, and pair up to 20\.0 ms"),
    ):
        list(sequence)


def test_a_given_calibration_takes_the_place_of_the_camera_info(tmp_path: Path) -> None:
    messages = [m for m in recorded(FRAMES) if m.topic != INFO]
    folder = write_rosbag2(tmp_path / "bag", messages)
    with pytest.raises(InputError, match="no topic of camera info found"):
        BagRecording(folder)
    given = replace(CAMERA, fx=70.0)
    with BagRecording(folder, calibration=given) as sequence:
        assert [frame.intrinsics for frame in sequence] == [given] * len(FRAMES)


def test_depth_that_may_not_be_registered_is_warned_of_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    elsewhere = [replace(f, frame_id="depth_optical") for f in FRAMES]
    messages = [m for m in recorded(FRAMES) if m.topic != DEPTH]
    messages += [m for m in recorded(elsewhere) if m.topic == DEPTH]
    with BagRecording(write_rosbag2(tmp_path / "bag", messages)) as sequence:
        assert len(list(sequence)) == len(FRAMES)
    assert caplog.text.count("if depth is not registered to colour") == 1


@pytest.mark.parametrize(("topic", "kind"), [(DEPTH, "depth"), (COLOR, "color")])
def test_where_a_stream_pauses_the_images_without_a_partner_are_counted_and_said(
    topic: str, kind: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frames = make_frames(30)
    pause = {frame.stamp_ns for frame in frames[10:20]}
    messages = [m for m in recorded(frames) if m.topic != topic or m.stamp_ns not in pause]
    with BagRecording(write_rosbag2(tmp_path / "bag", messages)) as sequence:
        assert len(list(sequence)) == 20
        left_out = sequence.left_out
    other = {"depth": "color", "color": "depth"}[kind]
    assert left_out == LeftOut({kind: 20, other: 30}, {kind: 0, other: 10})
    (said,) = caplog.messages
    assert f"10 of 30 {other} images have no partner near their stamp" in said
    # eleven periods, from the last frame before the pause on
    assert "is 0.37 s, from 1300000000.300 s on" in said


def test_images_before_the_first_camera_info_are_counted_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frames = make_frames(80)
    messages = [m for m in recorded(frames) if m.topic != INFO or m.stamp_ns == frames[-1].stamp_ns]
    with BagRecording(write_rosbag2(tmp_path / "bag", messages)) as sequence:
        found = len(list(sequence))
        assert 0 < found < 80
        assert sequence.left_out.unpaired == {"color": 80 - found, "depth": 80 - found}
    assert f"{80 - found} of 80 color images and {80 - found} of 80 depth images" in caplog.text


def test_images_that_come_twice_are_counted_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    twice = [m for frame in FRAMES for m in recorded([frame]) * 2]
    with BagRecording(write_rosbag2(tmp_path / "bag", twice)) as sequence:
        assert len(list(sequence)) == len(FRAMES)
        assert sequence.left_out.duplicates == len(FRAMES)
    assert f"images that repeat a stamp and were left out: {len(FRAMES)}" in caplog.text


def test_where_most_images_repeat_a_stamp_the_time_of_recording_is_named_and_tells_them_apart(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    messages = [
        replace(m, stamp_ns=frame.stamp_ns)
        for frame in FRAMES
        for m in recorded([replace(frame, stamp_ns=START_NS)])
    ]
    bag = write_rosbag2(tmp_path / "bag", messages)
    with BagRecording(bag) as sequence:
        assert len(list(sequence)) == 1
    assert f"were left out: {len(FRAMES) - 1}; if these are different images" in caplog.text
    assert "--set stamps=receipt" in caplog.text
    caplog.clear()
    with BagRecording(bag, inputs=InputConfig(stamps="receipt")) as sequence:
        assert [frame.stamp_ns for frame in sequence] == [frame.stamp_ns for frame in FRAMES]
    assert not caplog.messages


def test_a_bag_of_a_looped_recording_gives_all_rounds(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Recorded later, but with the stamps of the first round again."""
    frames = make_frames(40)
    again = [replace(m, stamp_ns=m.stamp_ns + 10**10) for m in recorded(frames)]
    folder = write_rosbag2(tmp_path / "bag", [*recorded(frames), *again])
    with BagRecording(folder) as sequence:
        stamps = [frame.stamp_ns for frame in sequence]
    assert stamps == [f.stamp_ns for f in frames] * 2
    assert caplog.text.count("time goes backward") == 1


def test_recorded_messages_are_what_rclpy_would_send(bag: Path) -> None:
    serialization = pytest.importorskip("rclpy.serialization", reason="needs rclpy")
    ros = pytest.importorskip("sensor_msgs.msg", reason="needs the ROS message packages")
    with BagFile(bag) as file:
        messages = list(file.messages([COLOR]))
        assert file.topics[COLOR].type == "sensor_msgs/msg/Image"
        assert file.topics[COLOR].message_count == len(messages) == len(FRAMES)
    for message, frame in zip(messages, FRAMES, strict=True):
        image = serialization.deserialize_message(bytes(message.data), ros.Image)
        assert message.stamp_ns == frame.stamp_ns
        assert np.array_equal(np.frombuffer(image.data, np.uint8), frame.color.ravel())


def test_topics_are_told_and_can_be_given(bag: Path) -> None:
    found = Topics(COLOR, DEPTH, INFO, None)
    with BagRecording(bag) as sequence:
        assert sequence.topics == found
    with BagRecording(bag, Topics(color="camera/rgb/image")) as sequence:
        assert sequence.topics == found


def test_the_files_are_released_when_topics_are_missing(bag: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(bag, tmp_path / "bag")
    with pytest.raises(InputError):
        BagRecording(folder, Topics(depth="/nowhere"))
    shutil.rmtree(folder)


def test_camera_infos_without_a_stamp_beside_stamped_images_are_reported_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frames = make_frames(4)
    messages = [
        replace(each, message=replace(each.message, header=header(0, "")))
        if each.topic == INFO
        else each
        for each in recorded(frames)
    ]
    with open_recording(write_rosbag2(tmp_path / "bag", messages)) as recording:
        assert [frame.stamp_ns for frame in recording] == [frame.stamp_ns for frame in frames]
    (said,) = caplog.messages
    assert said.startswith(f"{INFO}: camera infos have no stamp, though images do")
