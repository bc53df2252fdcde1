from __future__ import annotations

import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rigs.bags import CODECS, PERIOD_NS, START_NS, assert_same_frame, make_frames
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, ConnectionExtRosbag2, QosDurability, QosReliability
from rosbags.rosbag2 import Writer

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.recordings.bag.recording import BagRecording
from rgbd_glue_ros.recordings.bag.writer import (
    AS_REALSENSE,
    CAMERA_FRAME,
    GROUND_TRUTH_TOPIC,
    RAW,
    BagWriter,
    ImageCodec,
)
from rgbd_glue_ros.recordings.convert import write_bag

FRAMES = make_frames(5)


def write(folder: Path, codec: ImageCodec) -> Path:
    with BagWriter(folder, codec) as bag:
        for frame in FRAMES:
            bag.write_pose(frame.stamp_ns, np.eye(4))
            bag.write(bag.encode(frame))
    return folder


@pytest.mark.parametrize("codec", CODECS.values(), ids=CODECS)
def test_what_is_written_is_read_back_by_itself(codec: ImageCodec, tmp_path: Path) -> None:
    with BagRecording(write(tmp_path / "bag", codec)) as sequence:
        for frame, original in zip(sequence, FRAMES, strict=True):
            assert_same_frame(frame, original, codec)
        assert sequence.ground_truth is not None
        assert sequence.ground_truth.stamps_ns.tolist() == [f.stamp_ns for f in FRAMES]


@pytest.mark.parametrize("codec", CODECS.values(), ids=CODECS)
def test_equal_frames_make_equal_bytes(codec: ImageCodec, tmp_path: Path) -> None:
    first, second = (write(tmp_path / side / "bag", codec) for side in ("left", "right"))
    for file in first.iterdir():
        assert file.read_bytes() == (second / file.name).read_bytes()


def test_topics_and_their_types_are_those_of_a_camera_driver(tmp_path: Path) -> None:
    compressed = "sensor_msgs/msg/CompressedImage"
    info = {AS_REALSENSE.info: "sensor_msgs/msg/CameraInfo"}
    pose = {GROUND_TRUTH_TOPIC: "geometry_msgs/msg/PoseStamped"}
    image = "sensor_msgs/msg/Image"
    expected = {
        "raw": {AS_REALSENSE.color: image, AS_REALSENSE.depth: image, **info, **pose},
        "compressed": {
            f"{AS_REALSENSE.color}/compressed": compressed,
            f"{AS_REALSENSE.depth}/compressedDepth": compressed,
            **info,
            **pose,
        },
    }
    for name, codec in CODECS.items():
        with AnyReader([write(tmp_path / name, codec)]) as reader:
            assert {c.topic: c.msgtype for c in reader.connections} == expected[name]
            assert reader.start_time == START_NS
            assert reader.duration == 4 * PERIOD_NS + 1


def test_publishers_offer_what_every_subscriber_can_take(tmp_path: Path) -> None:
    with AnyReader([write(tmp_path / "bag", RAW)]) as reader:
        for connection in reader.connections:
            assert isinstance(connection.ext, ConnectionExtRosbag2)
            (qos,) = connection.ext.offered_qos_profiles
            assert qos.reliability is QosReliability.RELIABLE
            assert qos.durability is QosDurability.VOLATILE
            assert qos.depth >= 10


def test_a_bag_is_whole_although_its_writing_was_interrupted(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    with pytest.raises(KeyboardInterrupt), BagWriter(folder, RAW) as bag:  # noqa: PT012
        bag.write(bag.encode(FRAMES[0]))
        raise KeyboardInterrupt
    with BagRecording(folder) as sequence:
        (frame,) = sequence
    assert_same_frame(frame, FRAMES[0])


def test_a_bag_that_is_written_when_a_signal_comes_holds_whole_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[str] = []
    write_message = Writer.write

    def write_interrupted(writer: Writer, topic: Connection, at_ns: int, data: memoryview) -> None:
        written.append(topic.topic)
        if len(written) == 4:
            signal.raise_signal(signal.SIGINT)
        write_message(writer, topic, at_ns, data)

    monkeypatch.setattr(Writer, "write", write_interrupted)
    with pytest.raises(KeyboardInterrupt), BagWriter(tmp_path / "bag", RAW) as bag:
        write_bag(FRAMES, None, bag)
    assert len(written) == 6
    with BagRecording(tmp_path / "bag") as recording:
        assert [frame.stamp_ns for frame in recording] == [f.stamp_ns for f in FRAMES[:2]]


def test_an_existing_folder_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "precious").touch()
    with pytest.raises(InputError, match=r"exists already.*; give a new folder"):
        BagWriter(tmp_path, RAW)
    assert [p.name for p in tmp_path.iterdir()] == ["precious"]


def test_a_frame_without_a_frame_name_gets_one(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", RAW) as bag:
        bag.write(bag.encode(replace(FRAMES[0], frame_id="")))
    with BagRecording(tmp_path / "bag") as sequence:
        assert [frame.frame_id for frame in sequence] == [CAMERA_FRAME]


@pytest.mark.parametrize("stamp_ns", [-1, 2**31 * 10**9])
def test_a_time_that_no_bag_holds_is_refused_and_the_bag_is_whole(
    stamp_ns: int, tmp_path: Path
) -> None:
    good, bad = make_frames(1)[0], replace(make_frames(1)[0], stamp_ns=stamp_ns)
    with BagWriter(tmp_path / "bag", RAW) as bag:
        bag.write(bag.encode(good))
        for frame in (bad, replace(good, depth_delay_ns=stamp_ns - good.stamp_ns)):
            with pytest.raises(InputError, match="bags store only 0 to 2\\^31 s"):
                bag.encode(frame)
        with pytest.raises(InputError, match="has a stamp of"):
            bag.write_pose(stamp_ns, np.eye(4))
    with BagRecording(tmp_path / "bag") as recording:
        assert [frame.stamp_ns for frame in recording] == [good.stamp_ns]
