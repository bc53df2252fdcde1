"""What is left in a bag whose end or index is missing: it was cut off, or its recorder killed.

Readers that rely on the index refuse such files; these read a file from its beginning as far as
it goes. There is one for each kind of file: MCAP, SQLite and ROS 1 (version 2.0).
"""

from __future__ import annotations

import bz2
import sqlite3
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO

import lz4.frame  # type: ignore[import-untyped]
from backports import zstd

from rgbd_glue_ros.recordings.bag.layout import (
    MCAP_MAGIC,
    ROS1_MAGIC,
    SQLITE_MAGIC,
    ZSTD_MAGIC,
    has_log,
)
from rgbd_glue_ros.types import NANOSECONDS

_BLOCK = 2**20


class DamagedError(Exception):
    """How a file stops making sense."""


@dataclass(frozen=True)
class RecordedMessage:
    """A message as it is in a bag.

    Attributes:
        topic: its name.
        type: as ``sensor_msgs/msg/Image``, in ROS 1 bags too.
        stamp_ns: time of recording, nanoseconds.
        data: serialised: CDR, in a ROS 1 bag that of ROS 1.
    """

    topic: str
    type: str
    stamp_ns: int
    data: bytes


def salvage(path: Path) -> Iterator[RecordedMessage]:
    """The messages of a bag file, in the order in which they were written.

    Raises:
        DamagedError: after the last message that can be read, unless the file is whole.
    """
    with path.open("rb") as file:
        magic = file.read(len(SQLITE_MAGIC))
    if magic.startswith(ZSTD_MAGIC):
        with TemporaryDirectory() as folder:
            plain = Path(folder) / path.stem
            _decompress(path, plain)
            yield from salvage(plain)
        return
    for start, read in _READERS.items():
        if magic.startswith(start):
            for message in _noticing_damage(read(path)):
                yield replace(message, data=_plain(message.data))
            return
    raise DamagedError("it does not begin like a bag")


def _decompress(path: Path, plain: Path) -> None:
    """As much as can be decompressed; where the rest is missing, the reader will notice."""
    with zstd.open(path, "rb") as source, plain.open("wb") as target:
        try:
            while block := source.read(_BLOCK):
                target.write(block)
        except (EOFError, zstd.ZstdError):
            pass


def _exactly(file: IO[bytes], size: int) -> bytes:
    data = file.read(size)
    if len(data) < size:
        raise DamagedError("it is cut off")
    return data


# MCAP: records of an opcode (1 byte), a length (8) and so much content
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F
_MCAP_RECORD = struct.Struct("<BQ")
_MCAP_MESSAGE = struct.Struct("<HIQQ")
_MCAP_CHUNK = struct.Struct("<QQQI")


class _Mcap:
    """Schemas and channels met so far."""

    def __init__(self) -> None:
        self._types: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}

    def messages(self, file: IO[bytes]) -> Iterator[RecordedMessage]:
        """The messages until the end of the data, or of the chunk that ``file`` is."""
        while head := file.read(_MCAP_RECORD.size):
            if len(head) < _MCAP_RECORD.size:
                raise DamagedError("it is cut off")
            kind, size = _MCAP_RECORD.unpack(head)
            if kind == _DATA_END:
                return
            if kind == _CHUNK:
                yield from self._chunk(file, size)
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
        # not all of a chunk need be there: an uncompressed one can be read as far as it goes
        chunk = file.read(size)
        compression = _text(chunk, _MCAP_CHUNK.size)
        start = _MCAP_CHUNK.size + 4 + len(compression) + 8
        yield from self.messages(BytesIO(_DECOMPRESS[compression](chunk[start:])))
        if len(chunk) < size:
            raise DamagedError("it is cut off")


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
        yield from _Mcap().messages(file)
        # the data end with a record of their own; after it come index and footer
        if not file.read(1):
            raise DamagedError("it is cut off")


# ROS 1: records of a length and header (name=value), and a length and data
_ROS1_MESSAGE, _ROS1_CHUNK, _ROS1_CONNECTION, _ROS1_HEADER = b"\x02", b"\x05", b"\x07", b"\x03"


class _Ros1:
    """Connections met so far."""

    def __init__(self) -> None:
        self.is_indexed = False
        self._connections: dict[bytes, tuple[str, str]] = {}

    def messages(self, file: IO[bytes]) -> Iterator[RecordedMessage]:
        """The messages until the end of the file, or of the chunk that ``file`` is."""
        while file.read(1):
            file.seek(-1, 1)
            header = _fields(_sized(file))
            data = _sized(file)
            kind = header[b"op"]
            if kind == _ROS1_HEADER:
                self.is_indexed = any(header[b"index_pos"])
            elif kind == _ROS1_CHUNK:
                plain = _DECOMPRESS[header[b"compression"].decode()](data)
                yield from self.messages(BytesIO(plain))
            elif kind == _ROS1_CONNECTION:
                topic, kind_name = header[b"topic"].decode(), _fields(data)[b"type"].decode()
                self._connections[header[b"conn"]] = topic, _ros2_name(kind_name)
            elif kind == _ROS1_MESSAGE:
                seconds, nanoseconds = struct.unpack("<II", header[b"time"])
                yield RecordedMessage(
                    *self._connections[header[b"conn"]], seconds * NANOSECONDS + nanoseconds, data
                )


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


# SQLite: pages; the header says their size (1 for 65536) and how many there are
_SQLITE_SIZES = struct.Struct(">16xH10xI")


def _salvage_sqlite(path: Path) -> Iterator[RecordedMessage]:
    with path.open("rb") as file:
        page_size, pages = _SQLITE_SIZES.unpack(file.read(_SQLITE_SIZES.size))
    page_size = 65536 if page_size == 1 else page_size
    messages = _sqlite_messages(path)
    if path.stat().st_size >= page_size * pages:
        yield from messages
        return
    yield from _without_the_last_larger_than(page_size, messages)
    raise DamagedError("it is cut off")


def _without_the_last_larger_than(
    page_size: int, messages: Iterator[RecordedMessage]
) -> Iterator[RecordedMessage]:
    """The messages up to the last one that needs more than a page.

    SQLite takes what is missing of the last page for zeros, so that the last message that goes on
    in further pages may end in zeros. Pages are filled in order: those before it are whole.
    """
    held: list[RecordedMessage] = []
    for message in messages:
        if len(message.data) > page_size:
            yield from held
            held = [message]
        elif held:
            held.append(message)
        else:
            yield message


def _sqlite_messages(path: Path) -> Iterator[RecordedMessage]:
    # a log beside the file is read only where the file may change
    mode = "mode=ro" if has_log(path) else "immutable=1"
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?{mode}", uri=True)
    try:
        # else SQLite would read nothing of a file that is shorter than its header says
        connection.execute("PRAGMA writable_schema = ON")
        topics = {
            number: (topic, message_type)
            for number, topic, message_type in connection.execute(
                "SELECT id, name, type FROM topics"
            )
        }
        for number, stamp_ns, data in connection.execute(
            "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
        ):
            yield RecordedMessage(*topics[number], stamp_ns, data)
    finally:
        connection.close()


def _noticing_damage(messages: Iterator[RecordedMessage]) -> Iterator[RecordedMessage]:
    """The messages; whatever nonsense makes a parser stumble becomes a ``DamagedError``."""
    try:
        yield from messages
    except (
        *(ValueError, KeyError, EOFError, OSError, RuntimeError, MemoryError, OverflowError),
        *(struct.error, sqlite3.Error, zstd.ZstdError),
    ) as error:
        raise DamagedError(f"it makes no sense from some place on ({error!r})") from error


def _plain(data: bytes) -> bytes:
    """A message's data, decompressed if rosbag2 compressed each message for itself.

    CDR never begins like zstd.
    """
    if data.startswith(ZSTD_MAGIC):
        with suppress(zstd.ZstdError):
            return zstd.decompress(data)
    return data


_DECOMPRESS: Mapping[str, Callable[[bytes], bytes]] = {
    "": bytes,
    "none": bytes,
    "zstd": zstd.decompress,
    "lz4": lz4.frame.decompress,
    "bz2": bz2.decompress,
}
_READERS: Mapping[bytes, Callable[[Path], Iterator[RecordedMessage]]] = {
    MCAP_MAGIC: _salvage_mcap,
    ROS1_MAGIC: _salvage_ros1,
    SQLITE_MAGIC: _salvage_sqlite,
}
