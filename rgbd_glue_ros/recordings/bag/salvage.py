"""Reads bags whose end or index is missing: truncated, or their recorder killed.

Readers that rely on the index refuse such files; these read a file from its beginning as far as
possible. There is one for each kind of file: MCAP, SQLite and ROS 1 (version 2.0).
"""

from __future__ import annotations

import os
import sqlite3
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import IO

from backports import zstd

from rgbd_glue_ros.files.reading import stand_in
from rgbd_glue_ros.recordings.bag.layout import (
    MCAP_MAGIC,
    ROS1_MAGIC,
    SQLITE_MAGIC,
    first_bytes,
)
from rgbd_glue_ros.recordings.bag.message import DamagedError, RecordedMessage
from rgbd_glue_ros.recordings.bag.sqlite import salvage_sqlite
from rgbd_glue_ros.recordings.bag.unpacking import (
    MAX_CHUNK,
    PlainFiles,
    unpacked,
    unpacked_message,
)
from rgbd_glue_ros.types import NANOSECONDS

# Errors that a parser may raise on invalid bytes
_NONSENSE = (
    *(ValueError, KeyError, EOFError, OSError, RuntimeError, MemoryError, OverflowError),
    *(struct.error, sqlite3.Error, zstd.ZstdError),
)


class _DamagedChunks:
    """Counts individually damaged chunks, so that what follows can be read."""

    def __init__(self) -> None:
        self._first: BaseException | None = None
        self._count = 0

    def passed_over(self, messages: Iterator[RecordedMessage]) -> Iterator[RecordedMessage]:
        """The messages of a chunk up to its damage."""
        try:
            yield from messages
        except (DamagedError, *_NONSENSE) as error:
            self._first = self._first or error
            self._count += 1

    def say(self) -> None:
        """Reports damaged chunks.

        Raises:
            DamagedError: some chunks were damaged.
        """
        if self._count:
            raise DamagedError(
                f"{self._count} of its chunks are damaged ({self._first!r}), the others are not"
            )


def salvage(path: Path) -> Iterator[RecordedMessage]:
    """The messages of a bag file, in the order in which they were written.

    Raises:
        DamagedError: after the last readable message, unless the file is intact.
    """
    with closing(PlainFiles()) as plain_files:
        plain = plain_files.of(path)
        magic = first_bytes(plain)
        for start, read in _READERS.items():
            if magic.startswith(start):
                for message in _noticing_damage(read(plain)):
                    yield replace(message, data=unpacked_message(message.data))
                return
    raise DamagedError(f"it {stand_in(magic) or 'does not start like a bag'}")


def _exactly(file: IO[bytes], size: int) -> bytes:
    if size > MAX_CHUNK:
        raise DamagedError(f"a part of it has {size} bytes")
    data = file.read(size)
    if len(data) < size:
        raise DamagedError("it is truncated")
    return data


def _skip(file: IO[bytes], size: int) -> None:
    here = file.tell()
    if size > file.seek(0, os.SEEK_END) - here:
        raise DamagedError("it is truncated")
    file.seek(here + size)


# MCAP: records of an opcode (1 byte), a length (8) and so much content
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F
_MCAP_RECORD = struct.Struct("<BQ")
_MCAP_MESSAGE = struct.Struct("<HIQQ")
_MCAP_CHUNK = struct.Struct("<QQQI")
_MCAP_SIZE = struct.Struct("<16xQ")


class _Mcap:
    """Schemas and channels read so far."""

    def __init__(self) -> None:
        self.damaged = _DamagedChunks()
        self._types: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}

    def messages(self, file: IO[bytes], *, is_chunk: bool = False) -> Iterator[RecordedMessage]:
        """The messages until the end of the data, or of the chunk that ``file`` is."""
        while head := file.read(_MCAP_RECORD.size):
            if len(head) < _MCAP_RECORD.size:
                raise DamagedError("it is truncated")
            kind, size = _MCAP_RECORD.unpack(head)
            if kind == _DATA_END:
                return
            if kind == _CHUNK:
                if is_chunk:
                    raise DamagedError("a chunk is inside another")
                yield from self._chunk(file, size)
                continue
            if kind not in (_SCHEMA, _CHANNEL, _MESSAGE):
                _skip(file, size)
                continue
            record = _exactly(file, size)
            if kind == _SCHEMA:
                (number,) = struct.unpack_from("<H", record)
                self._types[number] = _ros2_name(_text(record, 2))
            elif kind == _CHANNEL:
                number, schema = struct.unpack_from("<HH", record)
                self._channels[number] = _text(record, 4), self._types.get(schema, "")
            elif kind == _MESSAGE:
                number, _, stamp_ns, _ = _MCAP_MESSAGE.unpack_from(record)
                topic, message_type = self._channels[number]
                yield RecordedMessage(topic, message_type, stamp_ns, record[_MCAP_MESSAGE.size :])

    def _chunk(self, file: IO[bytes], size: int) -> Iterator[RecordedMessage]:
        # a chunk may be incomplete: an uncompressed one can be read as far as it goes
        chunk = file.read(size)
        messages = self._of_chunk(chunk)
        if len(chunk) < size:
            yield from messages
            raise DamagedError("it is truncated")
        yield from self.damaged.passed_over(messages)

    def _of_chunk(self, chunk: bytes) -> Iterator[RecordedMessage]:
        compression = _text(chunk, _MCAP_CHUNK.size)
        start = _MCAP_CHUNK.size + 4 + len(compression) + 8
        (declared,) = _MCAP_SIZE.unpack_from(chunk)
        plain = unpacked(chunk[start:], compression, declared)
        yield from self.messages(BytesIO(plain), is_chunk=True)


def _text(record: bytes, position: int) -> str:
    (size,) = struct.unpack_from("<I", record, position)
    return record[position + 4 : position + 4 + size].decode()


def _ros2_name(message_type: str) -> str:
    """``sensor_msgs/msg/Image``, which ROS 1 calls ``sensor_msgs/Image``."""
    package, _, name = message_type.rpartition("/")
    return message_type if "/" in package else f"{package}/msg/{name}"


def _salvage_mcap(path: Path) -> Iterator[RecordedMessage]:
    with path.open("rb") as file:
        file.seek(len(MCAP_MAGIC))
        reader = _Mcap()
        yield from reader.messages(file)
        # the data end with a record of their own; after it come index and footer
        if not file.read(1):
            raise DamagedError("it is truncated")
        reader.damaged.say()


# ROS 1: records of a length and header (name=value), and a length and data
_ROS1_MESSAGE, _ROS1_CHUNK, _ROS1_CONNECTION, _ROS1_HEADER = b"\x02", b"\x05", b"\x07", b"\x03"


class _Ros1:
    """Connections read so far."""

    def __init__(self) -> None:
        self.is_indexed = False
        self.damaged = _DamagedChunks()
        self._connections: dict[bytes, tuple[str, str]] = {}

    def messages(self, file: IO[bytes], *, is_chunk: bool = False) -> Iterator[RecordedMessage]:
        """The messages until the end of the file, or of the chunk that ``file`` is."""
        while file.read(1):
            file.seek(-1, 1)
            header = _fields(_sized(file))
            data = _sized(file)
            kind = header[b"op"]
            if kind == _ROS1_HEADER:
                self.is_indexed = any(header[b"index_pos"])
            elif kind == _ROS1_CHUNK:
                if is_chunk:
                    raise DamagedError("a chunk is inside another")
                yield from self.damaged.passed_over(self._of_chunk(header, data))
            elif kind == _ROS1_CONNECTION:
                topic, kind_name = header[b"topic"].decode(), _fields(data)[b"type"].decode()
                self._connections[header[b"conn"]] = topic, _ros2_name(kind_name)
            elif kind == _ROS1_MESSAGE:
                seconds, nanoseconds = struct.unpack("<II", header[b"time"])
                yield RecordedMessage(
                    *self._connections[header[b"conn"]], seconds * NANOSECONDS + nanoseconds, data
                )

    def _of_chunk(self, header: dict[bytes, bytes], data: bytes) -> Iterator[RecordedMessage]:
        (declared,) = struct.unpack("<I", header[b"size"])
        plain = unpacked(data, header[b"compression"].decode(), declared)
        yield from self.messages(BytesIO(plain), is_chunk=True)


def _sized(file: IO[bytes]) -> bytes:
    (size,) = struct.unpack("<I", _exactly(file, 4))
    return _exactly(file, size)


def _fields(header: bytes) -> dict[bytes, bytes]:
    fields = {}
    file = BytesIO(header)
    while file.tell() < len(header):
        name, _, value = _sized(file).partition(b"=")
        fields[name] = value
    return fields


def _salvage_ros1(path: Path) -> Iterator[RecordedMessage]:
    with path.open("rb") as file:
        file.seek(len(ROS1_MAGIC))
        reader = _Ros1()
        yield from reader.messages(file)
        if not reader.is_indexed:
            raise DamagedError("its recorder did not finish it")
        reader.damaged.say()


def _noticing_damage(messages: Iterator[RecordedMessage]) -> Iterator[RecordedMessage]:
    """The messages; any error of a parser on invalid bytes becomes a ``DamagedError``."""
    try:
        yield from messages
    except _NONSENSE as error:
        raise DamagedError(f"it is unreadable from some point on ({error!r})") from error


_READERS: Mapping[bytes, Callable[[Path], Iterator[RecordedMessage]]] = {
    MCAP_MAGIC: _salvage_mcap,
    ROS1_MAGIC: _salvage_ros1,
    SQLITE_MAGIC: salvage_sqlite,
}
