"""Unpacks compressed bags within limits: no more than declared, and never too much.

A chunk of a hundred kilobytes may expand to gigabytes of zeros.
"""

from __future__ import annotations

import bz2
import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame  # type: ignore[import-untyped]
from backports import zstd
from rosbags.rosbag1 import reader as rosbag1
from rosbags.rosbag2 import storage_mcap

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import open_file
from rgbd_glue_ros.recordings.bag.layout import (
    SQLITE_MAGIC,
    ZSTD_MAGIC,
    first_bytes,
    has_log,
    log_of,
)
from rgbd_glue_ros.recordings.bag.message import DamagedError

MAX_CHUNK = 2**28
"""Maximum bytes of a chunk or message: a hundred times what recorders write."""

MAX_FILE_RATIO = 100
"""Maximum ratio of sizes for a file that is compressed as a whole."""

_SMALL = 2**24
_BLOCK = 2**20
_FOLDER = "rgbd-glue-bag-"
# The temporary folder may be in memory
_MOST_COPIED = 2**31
# An unlocked folder is kept for this long, since it may be new
_AGE_S = 60


def unpacked(data: bytes, compression: str, declared: int = MAX_CHUNK) -> bytes:
    """Data of a chunk or message.

    Args:
        data: as recorded.
        compression: "" or none, zstd, lz4 or bz2.
        declared: its declared or maximum number of bytes.

    Raises:
        DamagedError: the data are truncated, of another compression, or larger than declared.
    """
    if compression in ("", "none"):
        return data
    if compression not in _DECOMPRESSORS:
        raise DamagedError(f"it is compressed with {compression!r}")
    limit = min(declared, MAX_CHUNK)
    parts: list[bytes] = []
    size = 0
    while data:
        # several frames in sequence, which some writers call one
        decompressor = _DECOMPRESSORS[compression]()
        part = decompressor.decompress(data, limit - size + 1)
        size += len(part)
        if size > limit:
            raise DamagedError(f"a part of {len(data)} bytes unpacks to more than {limit}")
        if not decompressor.eof:
            raise DamagedError("it is truncated")
        parts.append(part)
        data = decompressor.unused_data or b""
    return parts[0] if len(parts) == 1 else b"".join(parts)


def unpacked_message(data: bytes) -> bytes:
    """A message's data, unpacked if rosbag2 compressed each message individually.

    CDR never begins like zstd. What cannot be unpacked stays as it is, and is not a valid message.
    """
    if data.startswith(ZSTD_MAGIC):
        with suppress(zstd.ZstdError, DamagedError):
            return unpacked(data, "zstd")
    return data


class PlainFiles:
    """Files as readers need them, in a temporary folder if they are not so by themselves.

    Those compressed as a whole are unpacked, and a database with a log beside it is copied: SQLite
    reads a log only where it can write, and would leave a file of its own beside the recording.

    The folder is removed when it is closed, or when the process ends; after a killed process, the
    next one removes it.
    """

    def __init__(self) -> None:
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._lock = -1

    def of(self, path: Path) -> Path:
        """The file itself, or its unpacked form or copy, as far as possible.

        Raises:
            DamagedError: it unpacks to too much, or to more than the free space.
            InputError: a database and its log can neither be copied nor read where they are.
        """
        head = first_bytes(path)
        if head.startswith(SQLITE_MAGIC) and has_log(path):
            return self._copied(path)
        if not head.startswith(ZSTD_MAGIC):
            return path
        plain = self._place() / path.stem
        with open_file(path) as source, plain.open("wb") as target:
            _unpack_file(source, target)
        return plain

    def _place(self) -> Path:
        if self._folder is None:
            _remove_what_is_left()
            self._folder = tempfile.TemporaryDirectory(prefix=_FOLDER)
            self._lock = os.open(self._folder.name, os.O_RDONLY)
            fcntl.flock(self._lock, fcntl.LOCK_EX)
        return Path(self._folder.name)

    def _copied(self, path: Path) -> Path:
        files = (path, log_of(path))
        size = sum(file.stat().st_size for file in files)
        place = self._place()
        if size > min(_MOST_COPIED, shutil.disk_usage(place).free):
            if os.access(path.parent, os.W_OK):
                return path
            raise InputError(
                path,
                f"has a log beside it ({log_of(path).name}), which SQLite reads only in a folder "
                "where it can write",
                "copy the folder to where you can write",
            )
        for file in files:
            with open_file(file) as source, (place / file.name).open("wb") as target:
                shutil.copyfileobj(source, target, _BLOCK)
        return place / path.name

    def close(self) -> None:
        """Removes the folder."""
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None
            os.close(self._lock)


def _unpack_file(source: BinaryIO, target: BinaryIO) -> None:
    packed = os.fstat(source.fileno()).st_size
    limit = MAX_FILE_RATIO * packed + _SMALL
    declared = None
    with suppress(zstd.ZstdError):
        declared = zstd.get_frame_info(source.read(64)).decompressed_size
    source.seek(0)
    if declared is not None and declared > limit:
        raise DamagedError(f"its {packed} bytes unpack to {declared}")
    folder = Path(target.name).parent
    free = shutil.disk_usage(folder).free
    if (declared or packed) > free:
        raise DamagedError(f"it unpacks to {declared or packed} bytes, and {folder} has {free}")
    limit = min(declared or limit, free)
    written = 0
    # if the rest is missing, the reader will notice
    with suppress(EOFError, zstd.ZstdError), zstd.open(source, "rb") as plain:
        while block := plain.read(_BLOCK):
            written += len(block)
            if written > limit:
                raise DamagedError(f"its {packed} bytes unpack to more than {limit}")
            target.write(block)


def _remove_what_is_left() -> None:
    """Removes the folders of killed processes: those without a lock."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_FOLDER}*"):
        with suppress(OSError):
            descriptor = os.open(folder, os.O_RDONLY | os.O_NOFOLLOW)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if time.time() - os.fstat(descriptor).st_mtime > _AGE_S:
                    shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(descriptor)


_DECOMPRESSORS: Mapping[str, Callable[[], Any]] = {
    "zstd": zstd.ZstdDecompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "bz2": bz2.BZ2Decompressor,
}


def _bound_rosbags() -> None:
    """Imposes the limits on the readers of rosbags, which have none."""
    for name in ("zstd", "lz4"):
        storage_mcap.DECOMPRESSORS[name] = _of_size(name)
    for name in ("bz2", "lz4"):
        rosbag1.decompressors[name] = _of_any_size(name)


def _of_size(name: str) -> Callable[[bytes, int], bytes]:
    return lambda data, size: unpacked(data, name, size)


def _of_any_size(name: str) -> Callable[[bytes], bytes]:
    return lambda data: unpacked(data, name)


_bound_rosbags()
