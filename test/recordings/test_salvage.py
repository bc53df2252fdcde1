from __future__ import annotations

import re
import struct
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from rigs.bags import assert_same_frame, make_frames, recorded, write_rosbag1, write_rosbag2
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.recordings.bag.message import DamagedError
from rgbd_glue_ros.recordings.bag.recording import BagRecording
from rgbd_glue_ros.recordings.bag.salvage import salvage
from rgbd_glue_ros.types import RgbdFrame

FRAMES = make_frames(120)

KINDS = {
    "mcap": (StoragePlugin.MCAP, CompressionMode.NONE),
    "mcap with zstd chunks": (StoragePlugin.MCAP, CompressionMode.STORAGE),
    "mcap with zstd messages": (StoragePlugin.MCAP, CompressionMode.MESSAGE),
    "mcap as zstd file": (StoragePlugin.MCAP, CompressionMode.FILE),
    "sqlite": (StoragePlugin.SQLITE3, CompressionMode.NONE),
    "sqlite with zstd messages": (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    "sqlite as zstd file": (StoragePlugin.SQLITE3, CompressionMode.FILE),
}
ROS1 = {"ros1": "", "ros1 with bz2 chunks": "BZ2", "ros1 with lz4 chunks": "LZ4"}


@pytest.fixture(scope="module", params=[*KINDS, *ROS1])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file that holds the messages, in its folder if it is of ROS 2."""
    folder = tmp_path_factory.mktemp("bags") / "bag"
    if request.param in ROS1:
        file = folder.with_suffix(".bag")
        return write_rosbag1(file, recorded(FRAMES), ROS1[request.param])
    write_rosbag2(folder, recorded(FRAMES), *KINDS[request.param])
    (file,) = (p for p in folder.iterdir() if p.name != "metadata.yaml")
    return file


def copied(bag: Path, folder: Path, content: bytes) -> Path:
    """The bag with other content."""
    folder.mkdir()
    metadata = bag.parent / "metadata.yaml"
    if metadata.exists():
        (folder / metadata.name).write_bytes(metadata.read_bytes())
    (folder / bag.name).write_bytes(content)
    return folder if metadata.exists() else folder / bag.name


def read(path: Path) -> tuple[list[RgbdFrame], InputError | None]:
    frames = []
    with BagRecording(path) as sequence:
        try:
            for frame in sequence:
                frames.append(frame)  # noqa: PERF402 (what came before an error counts)
        except InputError as error:
            return frames, error
    return frames, None


def test_a_whole_file_is_read_to_its_end_without_its_index(bag: Path) -> None:
    assert len(list(salvage(bag))) == 3 * len(FRAMES)


def test_of_a_bag_cut_off_in_the_middle_the_frames_before_are_given_and_then_it_is_said(
    bag: Path, tmp_path: Path
) -> None:
    content = bag.read_bytes()
    path = copied(bag, tmp_path / "cut", content[: len(content) * 6 // 10])
    frames, error = read(path)
    assert len(FRAMES) // 3 < len(frames) < len(FRAMES)
    for frame, original in zip(frames, FRAMES, strict=False):
        assert_same_frame(frame, original)
    assert error is not None
    assert error.where == str(path)
    assert "what could be read before that was used" in str(error)
    assert "\n" not in str(error)


def test_behind_a_chunk_that_is_damaged_the_others_are_read_and_it_is_said(tmp_path: Path) -> None:
    path = write_rosbag1(tmp_path / "holed.bag", recorded(FRAMES), "LZ4")
    content = bytearray(path.read_bytes())
    chunks = [match.start() for match in re.finditer(rb"op=\x05", content)]
    assert len(chunks) > 3
    inside = chunks[1] + 500
    content[inside : inside + 64] = bytes(64)
    path.write_bytes(content)
    frames, error = read(path)
    assert len(FRAMES) // 3 < len(frames) < len(FRAMES)
    assert_same_frame(frames[0], FRAMES[0])
    assert_same_frame(frames[-1], FRAMES[-1])
    assert error is not None
    assert "1 of its chunks are damaged" in str(error)


@given(fraction=st.floats(0, 1))
@example(fraction=0.998046875)  # in the last page of an SQLite file
@settings(
    max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_wherever_a_bag_is_cut_off_its_beginning_is_read_or_it_is_refused(
    bag: Path, fraction: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    content = bag.read_bytes()
    path = copied(
        bag,
        tmp_path_factory.mktemp("cut") / "bag",
        content[: int(fraction * len(content))],
    )
    try:
        frames, error = read(path)
    except InputError:
        frames, error = [], None
    for frame, original in zip(frames, FRAMES, strict=False):
        assert_same_frame(frame, original)
    assert error is not None or len(frames) in (0, len(FRAMES))


@given(place=st.floats(0, 1, exclude_max=True), noise=st.binary(min_size=1, max_size=64))
@settings(
    max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_noise_anywhere_in_a_file_ends_its_reading_with_nothing_but_the_two_errors(
    bag: Path, place: float, noise: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    content = bytearray(bag.read_bytes())
    start = int(place * len(content))
    content[start : start + len(noise)] = noise
    path = copied(bag, tmp_path_factory.mktemp("noise") / "bag", bytes(content))
    with suppress(DamagedError):
        list(salvage(path / bag.name if path.is_dir() else path))
    with suppress(InputError):
        read(path)


def test_an_mcap_without_chunks_is_read_although_its_messages_are_out_of_order(
    tmp_path: Path,
) -> None:
    """As the recorder's preset fastwrite leaves it; nothing is wrong with such a file."""

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    def record(kind: int, content: bytes) -> bytes:
        return struct.pack("<BQ", kind, len(content)) + content

    schema = struct.pack("<H", 1) + text("std_msgs/msg/String") + text("ros2msg")
    schema += text("string data")
    channel = struct.pack("<HH", 1, 1) + text("/chatter") + text("cdr") + text("")
    stamps = [30, 10, 20]
    magic = b"\x89MCAP0\r\n"
    file = tmp_path / "fast.mcap"
    file.write_bytes(
        magic
        + record(1, text("ros2") + text("test"))
        + record(3, schema)
        + record(4, channel)
        + b"".join(record(5, struct.pack("<HIQQ", 1, 0, t, t) + b"\0\1\0\0") for t in stamps)
        + record(15, struct.pack("<I", 0))
        + record(2, struct.pack("<QQI", 0, 0, 0))
        + magic
    )
    with BagFile(file) as bag:
        assert sorted(m.stamp_ns for m in bag.messages()) == sorted(stamps)
        assert bag.damage is None
