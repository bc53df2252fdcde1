"""Writes results atomically, and only those of one run, whatever ends it or fills the disk."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import math
import os
import secrets
import shutil
import stat
from collections.abc import Collection, Iterator
from glob import escape
from pathlib import Path
from typing import Any

from rgbd_glue_ros.closing import Closing, uninterrupted
from rgbd_glue_ros.errors import InputError

# Errors of file systems without locks, such as some network ones
_NO_LOCKS = {errno.EBADF, errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP}

_TOKEN_BYTES = 4
_WRITABLE = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH


def not_written(path: Path, error: OSError) -> InputError:
    """The error for a file or folder that cannot be written."""
    is_full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    remedy = "free some space, or give another path" if is_full else "give another path"
    return InputError(path, f"cannot be written ({error.strerror or error})", remedy)


def write_whole(path: Path, content: str | bytes, backup: Path | None = None) -> None:
    """Writes a file (a text in UTF-8) under a temporary name, then renames it.

    Args:
        path: of the file.
        content: of the file.
        backup: name beside it for the file that is replaced, if there is one; None keeps none.

    Raises:
        InputError: it cannot be written, or is read-only; what was there before is unchanged.
    """
    aside = _aside(path)
    data = content.encode() if isinstance(content, str) else content
    try:
        _check_replaceable(path)
        with aside.open("xb") as file:
            file.write(data)
            file.flush()
            # otherwise a power cut may leave the name without content
            os.fsync(file.fileno())
        # only now, so that a full disk costs no earlier backup
        if backup is not None and path.exists():
            _keep(path, backup)
        aside.replace(path)
    except OSError as error:
        raise not_written(path, error) from error
    finally:
        # if the location itself is at fault, this fails like the rest
        with contextlib.suppress(OSError):
            aside.unlink(missing_ok=True)


def _keep(path: Path, backup: Path) -> None:
    """Gives a file a second name; what had that name is replaced."""
    linked = _aside(backup)
    try:
        os.link(path, linked)
        linked.replace(backup)
    except OSError:
        # file systems such as FAT have no links, so for a moment there is nothing under its name
        path.replace(backup)
    finally:
        # renaming one link of a file to another does nothing
        linked.unlink(missing_ok=True)


def check_writable(path: Path) -> None:
    """Makes the folders of a file that is to be written later, and tries whether it can be.

    What is there stays as it is.

    Raises:
        InputError: no file can be written there, or the one that is there is read-only.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _check_replaceable(path)
        aside = _aside(path)
        aside.open("xb").close()
        aside.unlink()
    except OSError as error:
        raise not_written(path, error) from error


def _aside(path: Path) -> Path:
    """A name beside the file, of this writer alone: others may save the same file at once."""
    return path.with_name(f".{path.name}.{secrets.token_hex(_TOKEN_BYTES)}.part")


def _left_asides(path: Path) -> Iterator[Path]:
    """What writers that were killed left beside a file."""
    token = "[0-9a-f]" * 2 * _TOKEN_BYTES
    return path.parent.glob(f".{escape(path.name)}.{token}.part")


def _check_replaceable(path: Path) -> None:
    if path.exists() and not path.is_file():
        # the file would replace a device or a pipe, if the user is permitted
        raise InputError(path, "exists and is not a file", "give another path")
    if path.exists() and not (os.access(path, os.W_OK) and path.stat().st_mode & _WRITABLE):
        # renaming replaces it, and the superuser may write to it, but somebody protected it
        raise InputError(path, "is read-only", "make it writable (chmod u+w), or give another path")


def json_text(content: Any) -> str:
    """Standard JSON with a line end; null for numbers that are not finite."""
    return json.dumps(finite(content), indent=2, allow_nan=False) + "\n"


def finite(value: Any) -> Any:
    """The value with None for every number in it that is not finite."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    return value


class _Lock:
    """Held on a folder by one process at a time, until it is closed or the process ends."""

    def __init__(self, folder: Path) -> None:
        self._descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                self.close()
                raise

    def close(self) -> None:
        os.close(self._descriptor)


class ResultFolder(Closing):
    """A folder that one run at a time writes its results to.

    Attributes:
        path: of the folder.
    """

    def __init__(self, path: Path, names: Collection[str]) -> None:
        """Creates the folder, and removes the results of an earlier run.

        Args:
            path: of the folder.
            names: of the files that the run will write. Whatever ends it, no file of another run
                is among them.

        Raises:
            InputError: it cannot be written, or another run is writing to it.
        """
        self.path = path
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._lock = _Lock(path)
        except BlockingIOError as error:
            raise InputError(
                path, "another run is writing to it", "wait for it, or give another folder (-o)"
            ) from error
        except OSError as error:
            raise not_written(path, error) from error
        try:
            for name in names:
                (path / name).unlink(missing_ok=True)
                for aside in _left_asides(path / name):
                    aside.unlink(missing_ok=True)
            (path / ".part").touch()
            (path / ".part").unlink()
        except OSError as error:
            self.close()
            raise not_written(path, error) from error

    def close(self) -> None:
        """Allows others to write to it."""
        self._lock.close()


class NewFolder:
    """A folder that appears under its name once it is written, or writing has ended.

    Attributes:
        path: its location until then; created by its writer.
    """

    def __init__(self, target: Path) -> None:
        """Reserves a temporary name beside the target.

        Args:
            target: must not exist.

        Raises:
            InputError: it exists, cannot be written, or another run is writing it.
        """
        if target.exists():
            raise InputError(target, "exists already", "give a new folder")
        self._target = target
        self._place = target.with_name(f".{target.name}.writing")
        self.path = self._place / target.name
        self._folder = ResultFolder(self._place, ())
        # from a killed run
        shutil.rmtree(self.path, ignore_errors=True)

    @uninterrupted()
    def close(self, *, is_of_use: bool = True) -> None:
        """Gives it its name; removes it if it is of no use.

        Raises:
            InputError: something else has taken that name; the folder stays where it is.
        """
        try:
            if is_of_use and self.path.exists():
                self.path.rename(self._target)
            shutil.rmtree(self._place, ignore_errors=True)
        except OSError as error:
            cause = not_written(self._target, error).cause
            raise InputError(self._target, cause, f"it is in {self.path}: move it") from error
        finally:
            self._folder.close()
