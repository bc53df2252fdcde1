"""Which files form a bag; imports nothing slow.

A file's type shows in its first bytes. In a folder only files with the name of a bag are examined,
since there may be a hundred thousand images beside them.
"""

from __future__ import annotations

import re
from pathlib import Path

from rgbd_glue_ros.files.reading import visible

METADATA = "metadata.yaml"

SUFFIXES = (".mcap", ".db3", ".bag")

MCAP_MAGIC = b"\x89MCAP0\r\n"
ROS1_MAGIC = b"#ROSBAG V2.0\n"
SQLITE_MAGIC = b"SQLite format 3\0"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"

SIGNATURE = f"{METADATA} or *{', *'.join(SUFFIXES)}"

# Also unfinished (.bag.active) or compressed (.db3.zstd) recordings
_NAME = re.compile(r".*\.(mcap|db3|bag)(\.[a-z0-9]+)?", re.IGNORECASE)
# Recorders number the parts of a bag from 0; ROS 1 puts the date of each before its number
_PART = re.compile(r"(.*?)(\d{4}(-\d\d){5})?_(\d+)")


def storage_files(path: Path) -> list[Path]:
    """The files with the messages of the bag at ``path``; none if it is not a bag."""
    if not path.is_dir():
        return [path] if path.is_file() and _is_storage(path) else []
    files = sorted(file for file in visible(path) if _NAME.fullmatch(file.name))
    # an unfinished recorder may leave an empty file beside the one that counts
    return [file for file in files if file.is_file()]


def is_bag(path: Path) -> bool:
    """Whether ``path`` looks like a bag, intact or not; a folder of several bags does not count."""
    return (path / METADATA).is_file() or bool(storage_files(path) and not separate_bags(path))


def separate_bags(path: Path) -> list[Path]:
    """The bags in a folder that are not parts of one; none if they are, or there is only one."""
    files = storage_files(path)
    if len(files) < 2 or (path / METADATA).is_file() or not path.is_dir():
        return []
    parts = [_PART.fullmatch(file.name.split(".")[0]) for file in files]
    names = {part[1] if part else None for part in parts}
    numbers = {int(part[4]) for part in parts if part}
    is_split = None not in names and len(names) == 1 and 0 in numbers and len(numbers) == len(files)
    return [] if is_split else files


def first_bytes(path: Path) -> bytes:
    """The bytes that identify a file's type; none if it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(256)
    except OSError:
        return b""


def is_ros1(path: Path) -> bool:
    """Whether the messages in a storage file are serialised as in ROS 1."""
    head = first_bytes(path)
    # an MCAP file begins with a record that names the profile of its messages
    is_ros1_mcap = head.startswith(MCAP_MAGIC) and head[17:25] == b"\x04\0\0\0ros1"
    return head.startswith(ROS1_MAGIC) or is_ros1_mcap


def has_log(path: Path) -> bool:
    """Whether there is a log beside an SQLite file with content that is not in it yet."""
    log = log_of(path)
    return log.is_file() and log.stat().st_size > 0


def log_of(path: Path) -> Path:
    """The place of the log of an SQLite file."""
    return path.with_name(f"{path.name}-wal")


def lacks_log(path: Path) -> bool:
    """Whether an SQLite file was written with a log, which is not beside it."""
    head = first_bytes(path)
    return head.startswith(SQLITE_MAGIC) and head[18:20] == b"\2\2" and not has_log(path)


def _is_storage(path: Path) -> bool:
    magics = (MCAP_MAGIC, ROS1_MAGIC, SQLITE_MAGIC)
    return first_bytes(path).startswith(magics) or _NAME.fullmatch(path.name) is not None
