"""Unpacks archives from the network: files and folders below one folder, up to a limit."""

from __future__ import annotations

import errno
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
from typing import IO, Any

from rgbd_glue_ros.errors import InputError

MAX_RATIO = 10
"""Maximum ratio of sizes; images are already compressed, and hardly shrink."""

MAX_ENTRIES = 1_000_000
"""Maximum number of files and folders in the archive and all archives in it together."""

# whatever the ratio, this much does no harm
_SMALL = 2**24
_BLOCK = 2**20
# what tar may store about a file before its content, such as a long name
_MAX_HEADERS = 2**20
_REMEDY = "do not trust it, or download it again"

# A name that is too long, a position before the beginning
_NONSENSE = {errno.ENAMETOOLONG, errno.EINVAL}

# Errors that readers raise on invalid data; InputError is a ValueError, but raised on purpose.
_DAMAGE = (
    *(tarfile.TarError, gzip.BadGzipFile, zipfile.BadZipFile, zlib.error, lzma.LZMAError),
    *(EOFError, RuntimeError, NotImplementedError, struct.error, ValueError),
    *(LookupError, OverflowError, MemoryError),
)


def unpack(archive: Path, folder: Path, on_bytes: Callable[[int], None] = lambda _: None) -> None:
    """Unpacks a .zip, .tgz or .tar.gz into a new folder.

    Zip archives inside it (7-Scenes has one for every sequence) are unpacked in place and removed,
    one level deep.

    Args:
        archive: the file.
        folder: is created; whatever was unpacked before an error remains there.
        on_bytes: called with the number of bytes written, for every block.

    Raises:
        InputError: the archive is damaged, contains anything but files and folders, names a path
            outside the folder or one twice, or unpacks, with all archives in it, to more than
            ``MAX_RATIO`` times its size or to more than ``MAX_ENTRIES`` files and folders.
    """
    folder.mkdir(parents=True)
    budget = _Budget(archive)
    _unpack(archive, folder, budget, on_bytes)
    for inner in sorted(folder.rglob("*.zip")):
        _unpack(inner, inner.parent, budget, on_bytes)
        inner.unlink()


class _Budget:
    """What an archive and all archives in it may still expand to, counted before it is written."""

    def __init__(self, archive: Path) -> None:
        self._archive = archive
        self._bytes = MAX_RATIO * archive.stat().st_size + _SMALL
        self._entries = MAX_ENTRIES

    def take(self, size: int) -> None:
        """Uses a number of bytes."""
        self._bytes -= size
        self._check()

    def take_entry(self, name: str) -> None:
        """Uses an entry, whose name may be long and contain further folders."""
        self._entries -= 1 + name.count("/")
        self._bytes -= len(name)
        self._check()

    def _check(self) -> None:
        if self._bytes < 0 or self._entries < 0:
            raise InputError(
                self._archive,
                f"unpacks to more than {MAX_RATIO} times its size, or to more than "
                f"{MAX_ENTRIES} files and folders",
                _REMEDY,
            )


def _unpack(archive: Path, folder: Path, budget: _Budget, on_bytes: Callable[[int], None]) -> None:
    members = _zip_members if archive.suffix == ".zip" else _tar_members
    try:
        for name, content in members(archive, budget):
            budget.take_entry(name)
            target = folder / _inside(archive, name)
            if content is None:
                target.mkdir(parents=True, exist_ok=True)
                continue
            target.parent.mkdir(parents=True, exist_ok=True)
            with content, target.open("xb") as file:
                while block := content.read(_BLOCK):
                    budget.take(len(block))
                    file.write(block)
                    on_bytes(len(block))
    except InputError:
        raise
    except (FileExistsError, IsADirectoryError, NotADirectoryError) as error:
        raise InputError(archive, f"holds {error.filename} twice", _REMEDY) from error
    except _DAMAGE as error:
        raise InputError(archive, f"is damaged ({error})", _REMEDY) from error
    except OSError as error:
        if error.errno not in _NONSENSE:
            raise
        raise InputError(archive, f"is damaged ({error.strerror})", _REMEDY) from error


def _inside(archive: Path, name: str) -> PurePosixPath:
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or {*name} & {"\\", "\0"}:
        raise InputError(archive, f"holds {name!r}, a path outside its folder", _REMEDY)
    return path


class _TarStream:
    """A tar stream out of gzip: all of it is within the budget, and so are its headers."""

    def __init__(self, stream: gzip.GzipFile, budget: _Budget) -> None:
        self._stream = stream
        self._budget = budget
        self._headers: int | None = _MAX_HEADERS

    def begin_headers(self) -> None:
        """Headers follow, which are kept in memory until complete."""
        self._headers = _MAX_HEADERS

    def begin_content(self) -> None:
        """Content follows, which is written out."""
        self._headers = None

    def read(self, size: int) -> bytes:
        data = self._stream.read(size)
        if self._headers is not None:
            self._budget.take(len(data))
            self._headers -= len(data)
            if self._headers < 0:
                raise tarfile.ReadError(f"a header of more than {_MAX_HEADERS} bytes")
        return data


def _tar_members(archive: Path, budget: _Budget) -> Iterator[tuple[str, IO[bytes] | None]]:
    """Name and content of every member; no content for a folder."""
    with gzip.open(archive) as stream:
        bounded: Any = _TarStream(stream, budget)
        with tarfile.open(fileobj=bounded, mode="r|") as tar:
            while (member := tar.next()) is not None:
                # tarfile keeps the members it has read
                tar.members.clear()  # type: ignore[attr-defined]
                bounded.begin_content()
                if member.isdir():
                    yield member.name, None
                elif member.isreg():
                    yield member.name, tar.extractfile(member)
                else:
                    raise InputError(
                        archive, f"holds {member.name!r}, which is neither file nor folder", _REMEDY
                    )
                bounded.begin_headers()
        # gzip's checksum comes after the part that tar uses
        if len(stream.read(_SMALL)) == _SMALL:
            raise InputError(archive, "continues after its end", _REMEDY)


def _zip_members(archive: Path, _: _Budget) -> Iterator[tuple[str, IO[bytes] | None]]:
    """Name and content of every member; no content for a folder."""
    with zipfile.ZipFile(archive) as zipped:
        for member in zipped.infolist():
            # a file's type is where Unix stores it; others leave it zero
            kind = stat.S_IFMT(member.external_attr >> 16)
            if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise InputError(
                    archive, f"holds {member.filename!r}, which is neither file nor folder", _REMEDY
                )
            yield member.filename, None if member.is_dir() else zipped.open(member)


def only_folder(folder: Path) -> Path:
    """The folder that contains everything that was unpacked."""
    inside = list(folder.iterdir())
    return inside[0] if len(inside) == 1 and inside[0].is_dir() else folder


def remove(folder: Path) -> None:
    """Removes what unpacking left behind."""
    shutil.rmtree(folder, ignore_errors=True)
