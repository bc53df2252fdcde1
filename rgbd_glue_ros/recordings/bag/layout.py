"""Which files make a bag; imports nothing that takes time."""

from __future__ import annotations

from pathlib import Path

METADATA = "metadata.yaml"

SUFFIXES = (".mcap", ".db3", ".bag")

# appended to the others by rosbag2 when it compresses whole files
_COMPRESSED = ".zstd"

SIGNATURE = f"{METADATA} or *{', *'.join(SUFFIXES)}"


def storage_files(path: Path) -> list[Path]:
    """The files that hold the messages of the bag at ``path``; none if it is no bag."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return [file for file in files if file.name.removesuffix(_COMPRESSED).endswith(SUFFIXES)]


def is_bag(path: Path) -> bool:
    """Whether it looks like a bag, whole or not."""
    return bool(storage_files(path)) or (path / METADATA).is_file()
