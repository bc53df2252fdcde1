"""Opens files named by input: only regular ones, without waiting, and up to a limited size.

A list in a downloaded folder may name ``/dev/zero``, a pipe or a private file.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from rgbd_glue_ros.errors import InputError

MAX_TEXT = 2**28
"""Maximum bytes of a text: a pose for every frame of a month."""

MAX_IMAGE = 2**28
"""Maximum bytes of an image file: twice the largest that is decoded, in colour and uncompressed."""

FileIdentity = tuple[int, int, int, int]
"""Device, inode, bytes and nanoseconds of the last change."""

_GIT_LFS = b"version https://git-lfs.github.com/spec/"
_PAGE = re.compile(rb"\s*(<\?xml[^>]*>\s*)?<(!doctype html|html|error)\b", re.IGNORECASE)


def open_file(path: Path) -> BinaryIO:
    """Opens a regular file for reading.

    Raises:
        InputError: it is not a regular file, or cannot be read.
    """
    descriptor = -1
    try:
        # otherwise opening a pipe would wait for its writer
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY)
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise InputError(path, "is not a regular file", "give a file")
        return os.fdopen(descriptor, "rb")
    except (OSError, ValueError) as error:
        if descriptor >= 0:
            os.close(descriptor)
        if isinstance(error, InputError):
            raise
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(path, f"cannot be read ({reason})", _remedy(error)) from error


def _remedy(error: Exception) -> str:
    """What to do about a file that cannot be opened."""
    if isinstance(error, (FileNotFoundError, NotADirectoryError)):
        return "check the path"
    if isinstance(error, PermissionError):
        return "give read permission for the file and its folders"
    return "restore the file"


def file_identity(path: Path) -> FileIdentity | None:
    """What changes when a file is replaced or written to; None if there is no such file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def read_bytes(path: Path, most: int) -> bytes:
    """The contents of a file of at most ``most`` bytes.

    Raises:
        InputError: the file is larger, not a regular file, or cannot be read.
    """
    with open_file(path) as file:
        try:
            size = os.fstat(file.fileno()).st_size
            data = file.read(most + 1) if size <= most else b""
        except OSError as error:
            raise InputError(
                path, f"cannot be read ({error.strerror})", "restore the file"
            ) from error
    # the file may have grown since
    if max(size, len(data)) > most:
        raise InputError(path, f"holds more than {most} bytes", "give the intended file")
    return data


def read_text(path: Path, most: int = MAX_TEXT) -> str:
    """The contents of a text file in UTF-8, with or without a byte-order mark.

    Raises:
        InputError: the file is not a text, or as in ``read_bytes``.
    """
    data = read_bytes(path, most)
    refuse_stand_in(data, path)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(path, "is not a text", "give a text file") from error


def stand_in(data: bytes) -> str | None:
    """What stands in place of a file with these first bytes, to be downloaded again; None if none.

    A clone without Git LFS has pointers, and a browser or wget saves a login or an error as a file.
    """
    if data.startswith(_GIT_LFS):
        return "is a pointer of Git LFS in place of the file"
    if _PAGE.match(data.removeprefix(b"\xef\xbb\xbf")[:200]):
        return "is a web page in place of the file"
    return None


def refuse_stand_in(data: bytes, path: Path) -> None:
    """Refuses a file with these first bytes that stands in place of another one.

    Raises:
        InputError: it does.
    """
    cause = stand_in(data)
    if cause is not None:
        raise InputError(path, cause, "download the file again, from a clone by: git lfs pull")


def visible(folder: Path, pattern: str | None = None) -> Iterator[Path]:
    """What is in a folder, or of it what a pattern names, without hidden files and folders.

    macOS leaves a ``._name`` beside every file that it copies to a disk of another system.
    """
    found = folder.iterdir() if pattern is None else folder.glob(pattern)
    return (path for path in found if not path.name.startswith("."))


def inside(folder: Path, name: str) -> Path:
    """The path in a folder that a file there names.

    Links are followed: to use files from elsewhere, put a link to them into the folder.

    Raises:
        InputError: the path is outside the folder.
    """
    root = os.path.abspath(folder)  # noqa: PTH100 - a path without its dots, links untouched
    place = os.path.abspath(os.path.join(root, name))  # noqa: PTH100, PTH118
    if "\0" in name or os.path.commonpath([root, place]) != root:
        raise InputError(
            folder, f"names {name!r}, which is outside it", "put a link to it into the folder"
        )
    return folder / os.path.relpath(place, root)
