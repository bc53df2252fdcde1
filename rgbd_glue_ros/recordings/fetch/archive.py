"""Unpacks archives from the network: files and folders below one folder, and not without end."""

from __future__ import annotations

import gzip
import lzma
import shutil
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from typing import IO

from rgbd_glue_ros.errors import InputError

MAX_RATIO = 10
"""Bytes out for a byte in; images are compressed already, and hardly shrink."""

MAX_FILES = 1_000_000

# whatever its ratio, so much does no harm
_SMALL = 2**24
_BLOCK = 2**20
_REMEDY = "do not trust it, or download it again"

# What readers raise on nonsense; InputError is a ValueError, but raised on purpose.
_DAMAGE = (
    *(tarfile.TarError, gzip.BadGzipFile, zipfile.BadZipFile, zlib.error, lzma.LZMAError),
    *(EOFError, RuntimeError, NotImplementedError, struct.error, UnicodeError),
)


def unpack(archive: Path, folder: Path, on_bytes: Callable[[int], None] = lambda _: None) -> None:
    """Unpacks a .zip, .tgz or .tar.gz into a folder that is not there yet.

    Zip archives inside it (7-Scenes has one for every sequence) are unpacked where they lie and
    removed, one level deep.

    Args:
        archive: the file.
        folder: is created; whatever was unpacked before an error remains there.
        on_bytes: called with the number of bytes written, for every block.

    Raises:
        InputError: the archive is damaged, holds anything but files and folders, names a place
            outside the folder or one twice, or unpacks to more than ``MAX_RATIO`` times its size.
    """
    folder.mkdir(parents=True)
    _unpack(archive, folder, on_bytes)
    for inner in sorted(folder.rglob("*.zip")):
        _unpack(inner, inner.parent, on_bytes)
        inner.unlink()


def _unpack(archive: Path, folder: Path, on_bytes: Callable[[int], None]) -> None:
    limit = MAX_RATIO * archive.stat().st_size + _SMALL
    written = files = 0
    members = _zip_members if archive.suffix == ".zip" else _tar_members
    try:
        for name, content in members(archive):
            target = folder / _inside(archive, name)
            if content is None:
                target.mkdir(parents=True, exist_ok=True)
                continue
            files += 1
            target.parent.mkdir(parents=True, exist_ok=True)
            with content, target.open("xb") as file:
                while block := content.read(_BLOCK):
                    written += len(block)
                    if written > limit or files > MAX_FILES:
                        raise InputError(
                            archive,
                            f"unpacks to more than {MAX_RATIO} times its size, or to more than "
                            f"{MAX_FILES} files",
                            _REMEDY,
                        )
                    file.write(block)
                    on_bytes(len(block))
    except (FileExistsError, IsADirectoryError, NotADirectoryError) as error:
        raise InputError(archive, f"holds {error.filename} twice", _REMEDY) from error
    except _DAMAGE as error:
        raise InputError(archive, f"is damaged ({error})", _REMEDY) from error


def _inside(archive: Path, name: str) -> PurePosixPath:
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\\" in name:
        raise InputError(archive, f"holds {name!r}, a place outside its folder", _REMEDY)
    return path


def _tar_members(archive: Path) -> Iterator[tuple[str, IO[bytes] | None]]:
    """Name and content of every member; no content for a folder."""
    with gzip.open(archive) as stream:
        with tarfile.open(fileobj=stream, mode="r|") as tar:
            for member in tar:
                if member.isdir():
                    yield member.name, None
                elif member.isreg():
                    yield member.name, tar.extractfile(member)
                else:
                    raise InputError(archive, f"holds {member.name!r}, no file or folder", _REMEDY)
        # gzip's checksum comes after what tar has a use for
        if len(stream.read(_SMALL)) == _SMALL:
            raise InputError(archive, "goes on after its end", _REMEDY)


def _zip_members(archive: Path) -> Iterator[tuple[str, IO[bytes] | None]]:
    """Name and content of every member; no content for a folder."""
    with zipfile.ZipFile(archive) as zipped:
        for member in zipped.infolist():
            # a file's kind is where Unix has it; others leave it zero
            kind = stat.S_IFMT(member.external_attr >> 16)
            if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise InputError(archive, f"holds {member.filename!r}, no file or folder", _REMEDY)
            yield member.filename, None if member.is_dir() else zipped.open(member)


def only_folder(folder: Path) -> Path:
    """The folder in which everything is that was unpacked."""
    inside = list(folder.iterdir())
    return inside[0] if len(inside) == 1 and inside[0].is_dir() else folder


def remove(folder: Path) -> None:
    """Removes what an unpacking left."""
    shutil.rmtree(folder, ignore_errors=True)
