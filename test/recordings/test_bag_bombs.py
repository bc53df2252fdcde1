"""Bags that are small and stand for much: they are refused before memory or disk is taken."""

from __future__ import annotations

import bz2
import os
import resource
import shutil
import sqlite3
import struct
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from types import SimpleNamespace

import lz4.frame  # type: ignore[import-untyped]
import pytest
from backports import zstd
from rigs.bags import assert_same_frame, make_frames, recorded, write_rosbag1, write_rosbag2
from rosbags.rosbag2 import CompressionMode, StoragePlugin, storage_mcap

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.recordings.bag.recording import BagRecording

FRAMES = make_frames(6)
# Two gigabytes of zeros, in as many streams as that takes
ZEROS = bytes(2**24)
MOST_MB = 700


@pytest.fixture(autouse=True)
def _bounded_memory() -> Iterator[None]:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024 < MOST_MB


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where temporary files are."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def storage(folder: Path) -> Path:
    (file,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    return file


def mcap_bomb(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Its index is whole, and its one chunk stands for two gigabytes."""
    frame = zstd.compress(ZEROS)
    patched = SimpleNamespace(compress=lambda data: zstd.compress(data) + 128 * frame)
    with monkeypatch.context() as context:
        context.setattr(storage_mcap, "zstd", patched)
        return write_rosbag2(folder / "bag", recorded(FRAMES), compression=CompressionMode.STORAGE)


def mcap_file_bomb(folder: Path, _: pytest.MonkeyPatch) -> Path:
    path = folder / "bag.mcap.zstd"
    path.write_bytes(zstd.compress(b"\x89MCAP0\r\n") + 256 * zstd.compress(ZEROS))
    return path


def sqlite_file_bomb(folder: Path, _: pytest.MonkeyPatch) -> Path:
    plain = storage(write_rosbag2(folder / "bag", recorded(FRAMES), StoragePlugin.SQLITE3))
    path = folder / "bag.db3.zstd"
    path.write_bytes(zstd.compress(plain.read_bytes()) + 256 * zstd.compress(ZEROS))
    return path


def honest_bomb(folder: Path, _: pytest.MonkeyPatch) -> Path:
    """It says how much it is."""
    compressor = zstd.ZstdCompressor()
    compressor.set_pledged_input_size(128 * len(ZEROS))
    path = folder / "bag.mcap.zstd"
    parts = [compressor.compress(ZEROS) for _ in range(128)]
    path.write_bytes(b"".join([*parts, compressor.flush()]))
    return path


def ros1_bomb(
    compression: str, compressed: Callable[[bytes], bytes]
) -> Callable[[Path, pytest.MonkeyPatch], Path]:
    def make(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        bomb = 128 * compressed(ZEROS)
        plain = write_rosbag1(folder / "plain.bag", recorded(FRAMES), compression)
        file = folder / "bomb.bag"
        content = plain.read_bytes()
        # the data of the first chunk, after its header
        at = content.index(b"compression=")
        start = content.index(b"size=", at) + 9
        (size,) = struct.unpack_from("<I", content, start)
        data = compressed(b"") + bomb
        file.write_bytes(
            content[:start] + struct.pack("<I", len(data)) + data + content[start + 4 + size :]
        )
        return file

    return make


def changed_sqlite(*statements: str) -> Callable[[Path, pytest.MonkeyPatch], Path]:
    def make(folder: Path, _: pytest.MonkeyPatch) -> Path:
        bag = write_rosbag2(folder / "bag", recorded(FRAMES), StoragePlugin.SQLITE3)
        with closing(sqlite3.connect(storage(bag))) as connection:
            for statement in statements:
                connection.execute(statement)
            connection.commit()
        return bag

    return make


ENDLESS = (
    "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
    "SELECT i AS id, 1 AS topic_id, i AS timestamp, zeroblob(1000) AS data FROM n"
)
BOMBS: dict[str, Callable[[Path, pytest.MonkeyPatch], Path]] = {
    "MCAP chunk": mcap_bomb,
    "MCAP file": mcap_file_bomb,
    "MCAP file that says its size": honest_bomb,
    "SQLite file": sqlite_file_bomb,
    "ROS 1 chunk, bz2": ros1_bomb("BZ2", bz2.compress),
    "ROS 1 chunk, lz4": ros1_bomb("LZ4", lz4.frame.compress),
    "endless view": changed_sqlite(
        "DROP TABLE messages",
        f"CREATE VIEW messages AS {ENDLESS}",
    ),
    "endless view of definitions": changed_sqlite(
        "ALTER TABLE message_definitions RENAME TO old",
        "CREATE VIEW message_definitions AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL "
        "SELECT i + 1 FROM n) SELECT i AS id, 'a' AS topic_type, 'ros2msg' AS encoding, "
        "'' AS encoded_message_definition, '' AS type_description_hash FROM n",
    ),
    "computed column": changed_sqlite(
        "ALTER TABLE messages RENAME COLUMN data TO old",
        "ALTER TABLE messages ADD COLUMN data BLOB AS (zeroblob(1000000000))",
    ),
}


@pytest.mark.parametrize("kind", BOMBS)
def test_a_bag_that_unpacks_to_more_than_it_should_is_refused_in_bounded_memory_and_disk(
    kind: str, tmp_path: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bomb = BOMBS[kind](tmp_path, monkeypatch)
    start = time.monotonic()
    with suppress(InputError), BagRecording(bomb) as recording:
        for _ in recording:
            assert sum(path.stat().st_size for path in temporary.rglob("*")) < 2**28
        pytest.fail("what is wrong with it is not said")
    assert time.monotonic() - start < 20
    assert not list(temporary.iterdir())


def test_a_file_that_does_not_fit_on_the_disk_is_refused_before_it_is_unpacked(
    tmp_path: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_rosbag2(tmp_path / "bag", recorded(FRAMES), compression=CompressionMode.FILE)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1000))
    with pytest.raises(InputError, match=r"it unpacks to .* bytes, and .* has 1000"):
        BagFile(bag)
    assert not list(temporary.iterdir())


def test_what_a_killed_process_unpacked_is_removed_by_the_next_and_a_living_one_s_is_not(
    tmp_path: Path, temporary: Path
) -> None:
    bag = write_rosbag2(tmp_path / "bag", recorded(FRAMES), compression=CompressionMode.FILE)
    with BagRecording(bag) as recording:
        (living,) = temporary.iterdir()
        os.utime(living, (0, 0))
        killed = temporary / f"{living.name}killed"
        shutil.copytree(living, killed)
        os.utime(killed, (0, 0))
        with BagRecording(bag) as other:
            assert not killed.exists()
            for found in (list(recording), list(other)):
                for frame, original in zip(found, FRAMES, strict=True):
                    assert_same_frame(frame, original)
    assert not list(temporary.iterdir())


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_messages_compressed_one_by_one_are_read_without_metadata(
    plugin: StoragePlugin, tmp_path: Path
) -> None:
    bag = write_rosbag2(tmp_path / "bag", recorded(FRAMES), plugin, CompressionMode.MESSAGE)
    (bag / "metadata.yaml").unlink()
    for path in (bag, storage(bag)):
        with BagRecording(path) as recording:
            found = list(recording)
        for frame, original in zip(found, FRAMES, strict=True):
            assert_same_frame(frame, original)


@pytest.mark.parametrize("word", ["uint32 height", "string frame_id", "uint8[] data"])
def test_a_message_definition_with_a_turned_bit_does_not_matter(word: str, tmp_path: Path) -> None:
    """Messages are read by the definitions of the standard."""
    bag = write_rosbag2(tmp_path / "bag", recorded(FRAMES))
    file = storage(bag)
    content = file.read_bytes()
    turned = word[:-1] + chr(ord(word[-1]) ^ 1)
    assert word.encode() in content
    file.write_bytes(content.replace(word.encode(), turned.encode()))
    with BagRecording(bag) as recording:
        found = list(recording)
    for frame, original in zip(found, FRAMES, strict=True):
        assert_same_frame(frame, original)


def test_a_chunk_in_a_chunk_is_no_bag(tmp_path: Path) -> None:
    def record(kind: int, content: bytes) -> bytes:
        return struct.pack("<BQ", kind, len(content)) + content

    content = b""
    for _ in range(3):
        size = struct.pack("<QQQI", 0, 0, len(content), 0)
        content = record(6, size + struct.pack("<IQ", 0, len(content)) + content)
    path = tmp_path / "nested.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + content)
    with pytest.raises(InputError, match="holds no message"):
        BagFile(path)


@pytest.mark.parametrize("paths", ["null", "3", "[null, 3]", "{a: b}", "*a"])
def test_metadata_that_names_no_files_is_passed_over(paths: str, tmp_path: Path) -> None:
    bag = write_rosbag2(tmp_path / "bag", recorded(FRAMES))
    (bag / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information: {{relative_file_paths: {paths}}}\n"
    )
    with BagRecording(bag) as recording:
        assert len(list(recording)) == len(FRAMES)
