"""Bags in which the messages of one time were recorded far apart, with right stamps."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from rigs.bags import (
    CAMERA,
    COLOR,
    DEPTH,
    INFO,
    Recorded,
    assert_same_frame,
    make_frames,
    recorded,
    write_rosbag1,
    write_rosbag2,
)
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.recordings.bag.matching import QUEUE_SIZE
from rgbd_glue_ros.recordings.bag.recording import BagRecording
from rgbd_glue_ros.types import NANOSECONDS, RgbdFrame

FRAMES = make_frames(2 * QUEUE_SIZE + 5)
DAY_NS = 24 * 3600 * NANOSECONDS


def delayed(messages: list[Recorded], delays_ns: dict[str, int]) -> list[Recorded]:
    """The same messages, recorded later by topic, in the order of recording."""
    later = [replace(m, stamp_ns=m.stamp_ns + delays_ns.get(m.topic, 0)) for m in messages]
    return sorted(later, key=lambda m: m.stamp_ns)


# each topic after the one before, or depth behind by two seconds
APART = {
    "depth last": {DEPTH: 2 * DAY_NS, INFO: DAY_NS},
    "depth first": {COLOR: DAY_NS, INFO: 2 * DAY_NS},
    "info last": {INFO: DAY_NS},
    "depth late": {DEPTH: 2 * NANOSECONDS},
    "color late": {COLOR: 2 * NANOSECONDS},
}
WRITERS: dict[str, Callable[[Path, list[Recorded]], Path]] = {
    "MCAP": lambda path, messages: write_rosbag2(path / "bag", messages),
    "SQLite": lambda path, messages: write_rosbag2(path / "bag", messages, StoragePlugin.SQLITE3),
    "compressed": lambda path, messages: write_rosbag2(
        path / "bag", messages, StoragePlugin.MCAP, CompressionMode.FILE
    ),
    "ROS 1": lambda path, messages: write_rosbag1(path / "run.bag", messages, "LZ4"),
}


def assert_all_frames(sequence: BagRecording) -> None:
    for frame, original in zip(sequence, FRAMES, strict=True):
        assert_same_frame(frame, original)
    assert sequence.left_out.unpaired == {"color": 0, "depth": 0}
    assert sequence.left_out.images == {"color": len(FRAMES), "depth": len(FRAMES)}


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("apart", APART)
def test_topics_that_were_recorded_far_apart_give_all_frames(
    apart: str, writer: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bag = WRITERS[writer](tmp_path, delayed(recorded(FRAMES), APART[apart]))
    with BagRecording(bag) as sequence:
        for _ in range(2):
            assert_all_frames(sequence)
    assert not caplog.messages


def test_with_a_given_calibration_topics_far_apart_give_all_frames(tmp_path: Path) -> None:
    messages = delayed([m for m in recorded(FRAMES) if m.topic != INFO], {COLOR: DAY_NS})
    with BagRecording(write_rosbag2(tmp_path / "bag", messages), calibration=CAMERA) as sequence:
        assert_all_frames(sequence)


def test_of_a_damaged_bag_with_topics_far_apart_all_whole_messages_are_used(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    messages = delayed(recorded(FRAMES), {DEPTH: DAY_NS})
    bag = write_rosbag1(tmp_path / "run.bag", messages)
    data = bag.read_bytes()
    bag.write_bytes(data[: int(0.9 * len(data))])
    frames: list[RgbdFrame] = []
    with BagRecording(bag) as sequence:
        with pytest.raises(InputError, match="it is truncated"):
            frames.extend(sequence)
        assert QUEUE_SIZE < len(frames) == sequence.left_out.images["depth"] < len(FRAMES)
    for frame, original in zip(frames, FRAMES, strict=False):
        assert_same_frame(frame, original)
    assert not caplog.messages


def test_a_delay_that_begins_on_the_way_costs_no_frame(tmp_path: Path) -> None:
    late = {m.stamp_ns for m in recorded(FRAMES[20:])}
    messages = [
        replace(m, stamp_ns=m.stamp_ns + DAY_NS) if m.topic == DEPTH and m.stamp_ns in late else m
        for m in recorded(FRAMES)
    ]
    with BagRecording(write_rosbag2(tmp_path / "bag", delayed(messages, {}))) as sequence:
        assert_all_frames(sequence)


def test_messages_that_cannot_be_read_are_counted_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    messages = delayed(recorded(FRAMES), {DEPTH: DAY_NS})
    bag = write_rosbag2(tmp_path / "bag", messages, StoragePlugin.SQLITE3)
    with sqlite3.connect(next(bag.glob("*.db3"))) as database:
        # two of colour, before the topics are read beside each other, and one of depth
        for stamp in (FRAMES[3].stamp_ns, FRAMES[4].stamp_ns, FRAMES[9].stamp_ns + DAY_NS):
            database.execute(
                "UPDATE messages SET data = x'00' WHERE id = "
                "(SELECT id FROM messages WHERE timestamp = ? ORDER BY topic_id LIMIT 1)",
                [stamp],
            )
    with BagRecording(bag) as sequence:
        assert len(list(sequence)) == len(FRAMES) - 3
        assert sequence.skipped == 3


def test_a_looped_recording_with_depth_late_gives_all_rounds(tmp_path: Path) -> None:
    again = [replace(m, stamp_ns=m.stamp_ns + 10**10) for m in recorded(FRAMES)]
    messages = delayed([*recorded(FRAMES), *again], {DEPTH: 2 * NANOSECONDS})
    with BagRecording(write_rosbag2(tmp_path / "bag", messages)) as sequence:
        stamps = [frame.stamp_ns for frame in sequence]
    assert stamps == [frame.stamp_ns for frame in FRAMES] * 2
