"""Bags in the states in which people find them: what is there is read, what is missing is said."""

from __future__ import annotations

import logging
import os
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from rigs.bags import assert_same_frame, make_frames, recorded, write_rosbag1, write_rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.recordings import open_recording, recordings
from rgbd_glue_ros.recordings.bag import unpacking
from rgbd_glue_ros.recordings.bag.salvage import salvage
from rgbd_glue_ros.types import RgbdFrame

FRAMES = make_frames(6)


def storage(folder: Path) -> Path:
    (file,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    return file


def moved(source: Path, target: Path) -> Path:
    target.parent.mkdir(parents=True, exist_ok=True)
    return Path(shutil.move(source, target))


def ros1(folder: Path, name: str) -> Path:
    return moved(write_rosbag1(folder / "plain.bag", recorded(FRAMES)), folder / "at" / name)


def mcap(folder: Path, name: str) -> Path:
    return moved(storage(write_rosbag2(folder / "bag", recorded(FRAMES))), folder / "at" / name)


def in_its_folder(path: Path) -> Path:
    return path.parent


def with_log(folder: Path) -> Path:
    """A database whose recorder was killed: the messages are in the log beside it."""
    bag = write_rosbag2(folder / "bag", recorded(FRAMES), StoragePlugin.SQLITE3)
    file, killed = storage(bag), folder / "killed"
    killed.mkdir()
    connection = sqlite3.connect(file)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA wal_autocheckpoint=0")
    rows = connection.execute("SELECT * FROM messages ORDER BY id").fetchall()
    connection.execute("DELETE FROM messages")
    connection.commit()
    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    marks = ",".join("?" * len(rows[0]))
    connection.executemany(f"INSERT INTO messages VALUES ({marks})", rows)  # noqa: S608
    connection.commit()
    for suffix in ("", "-wal"):
        shutil.copy(f"{file}{suffix}", killed / f"{file.name}{suffix}")
    connection.close()
    return killed


def string(text: str) -> bytes:
    return len(text).to_bytes(4, "little") + text.encode()


def record(kind: int, content: bytes) -> bytes:
    return bytes([kind]) + len(content).to_bytes(8, "little") + content


def ros1_in_mcap(folder: Path) -> Path:
    """As the mcap program converts a ROS 1 bag; without its index."""
    bag = write_rosbag1(folder / "plain.bag", recorded(FRAMES))
    store = get_typestore(Stores.ROS1_NOETIC)
    magic = b"\x89MCAP0\r\n"
    parts = [magic, record(1, string("ros1") + string("test"))]
    numbers: dict[str, int] = {}
    for message in salvage(bag):
        if message.topic not in numbers:
            number = numbers[message.topic] = len(numbers) + 1
            text, _ = store.generate_msgdef(message.type)
            schema = string(message.type.replace("/msg/", "/")) + string("ros1msg") + string(text)
            two = number.to_bytes(2, "little")
            parts.append(record(3, two + schema))
            ends = string(message.topic) + string("ros1") + bytes(4)
            parts.append(record(4, two + two + ends))
        time = message.stamp_ns.to_bytes(8, "little")
        head = numbers[message.topic].to_bytes(2, "little") + bytes(4) + time + time
        parts.append(record(5, head + message.data))
    path = folder / "converted.mcap"
    path.write_bytes(b"".join([*parts, record(0x0F, bytes(4)), record(2, bytes(20)), magic]))
    return path


CONTAINERS: dict[str, Callable[[Path], Path]] = {
    "recorder interrupted": lambda folder: ros1(folder, "run.bag.active"),
    "recorder interrupted, in a folder": lambda f: in_its_folder(ros1(f, "run.bag.active")),
    "upper case": lambda folder: ros1(folder, "RUN.BAG"),
    "upper case MCAP in a folder": lambda folder: in_its_folder(mcap(folder, "RUN.MCAP")),
    "MCAP named as made of a bag": lambda folder: mcap(folder, "run.bag.mcap"),
    "MCAP named bag": lambda folder: mcap(folder, "run.bag"),
    "no ending": lambda folder: mcap(folder, "recording"),
    "another ending": lambda folder: ros1(folder, "run.rosbag"),
    "SQLite with its log": with_log,
    "ROS 1 messages in MCAP": ros1_in_mcap,
}


@pytest.mark.parametrize("state", CONTAINERS)
def test_what_a_file_is_shows_in_its_first_bytes(state: str, tmp_path: Path) -> None:
    with open_recording(CONTAINERS[state](tmp_path)) as recording:
        frames = list(recording)
    assert len(frames) == len(FRAMES)
    for frame, original in zip(frames, FRAMES, strict=True):
        assert_same_frame(frame, original)


def test_a_database_with_its_log_is_read_without_writing_beside_it(tmp_path: Path) -> None:
    folder = with_log(tmp_path)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with open_recording(folder) as recording:
        assert len(list(recording)) == len(FRAMES)
        assert {path.name for path in folder.iterdir()} == set(before)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_a_large_database_in_a_folder_for_reading_only_is_to_be_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = with_log(tmp_path)
    monkeypatch.setattr(unpacking, "_MOST_COPIED", 1)
    with open_recording(folder) as recording:
        assert len(list(recording)) == len(FRAMES)
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(InputError, match=r"-wal.*; copy the folder to where you can write"):
        open_recording(folder)


def test_an_empty_database_without_the_log_of_its_recorder_asks_for_it(tmp_path: Path) -> None:
    folder = with_log(tmp_path)
    (log,) = folder.glob("*-wal")
    log.unlink()
    with pytest.raises(InputError, match=f"holds no message: .*; copy {log.name} too"):
        open_recording(folder)


def parts(folder: Path, names: tuple[str, ...], metadata: bool = False) -> Path:
    """A file of two frames for each name, and metadata that name them all."""
    folder.mkdir()
    for i, name in enumerate(names):
        frames: list[RgbdFrame] = FRAMES[2 * i : 2 * i + 2]
        bag = write_rosbag2(folder.with_name(f"{folder.name}_{i}"), recorded(frames))
        moved(storage(bag), folder / name)
        if metadata:
            text = (bag / "metadata.yaml").read_text()
            (folder / "metadata.yaml").write_text(text)
        shutil.rmtree(bag)
    if metadata:
        text = (folder / "metadata.yaml").read_text()
        start = text.index("relative_file_paths:")
        rest = text[start:].split("\n")
        end = next(i for i, line in enumerate(rest[1:], 1) if not line.strip().startswith("-"))
        indent = rest[1][: rest[1].index("-")]
        listed = [rest[0], *(f"{indent}- {name}" for name in names), *rest[end:]]
        (folder / "metadata.yaml").write_text(text[:start] + "\n".join(listed))
    return folder


def test_parts_of_a_split_recording_are_one_and_others_are_not(tmp_path: Path) -> None:
    split = parts(tmp_path / "split", ("run_0.mcap", "run_1.mcap", "run_2.mcap"))
    assert recordings([split]) == [split]
    assert len(list(open_recording(split))) == 6
    runs = parts(tmp_path / "runs", ("monday.mcap", "tuesday.mcap"))
    assert recordings([runs]) == [runs / "monday.mcap", runs / "tuesday.mcap"]
    with pytest.raises(InputError, match=r"several recordings: monday\.mcap, tuesday\.mcap"):
        open_recording(runs)


def test_a_part_that_is_missing_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = parts(tmp_path / "run", ("run_0.mcap", "run_1.mcap", "run_2.mcap"), metadata=True)
    (folder / "run_1.mcap").unlink()
    with caplog.at_level(logging.WARNING), open_recording(folder) as recording:
        assert len(list(recording)) == 4
    assert "1 of its 3 parts is missing (run_1.mcap)" in caplog.text
