"""Results on disk as soon as they are known, so that an interrupted run can continue."""

from __future__ import annotations

import fcntl
import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.writing import finite

logger = logging.getLogger(__name__)

_FINISHED = "finished"


class Journal(Closing):
    """A file of JSON lines: a description of the run, the results, then a mark of completion.

    The file is created with the first result. That of an interrupted run is continued; that of a
    finished run is replaced.

    Attributes:
        done: the existing results, by their keys.
    """

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        """Reads what an earlier run left.

        Args:
            path: of the file.
            about: everything that the results depend on besides their keys, as JSON.

        Raises:
            InputError: the file cannot be read, or belongs to an interrupted run of something else.
        """
        self._path = path
        self._about = json.loads(json.dumps(about))
        self._file: TextIO | None = None
        self.done: dict[str, Any] = {}
        self._length = 0
        if path.is_file():
            self._read()

    def add(self, key: str, result: Any) -> None:
        """Writes a result; it is on disk when this returns.

        Raises:
            InputError: another run writes to the file.
        """
        self.done[key] = result
        self._write({"key": key, "result": result})

    def finish(self) -> None:
        """Marks the run as complete, so that the next one starts over."""
        if self.done:
            self._write({_FINISHED: True})

    def close(self) -> None:
        """Closes the file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _read(self) -> None:
        try:
            content = self._path.read_bytes()
        except OSError as error:
            raise InputError(
                self._path, f"cannot be read ({error.strerror})", "give another folder (-o)"
            ) from error
        # a process killed while writing leaves an incomplete line
        whole = content[: content.rfind(b"\n") + 1]
        try:
            about, *lines = (json.loads(line) for line in whole.splitlines())
            finished = bool(lines) and _FINISHED in lines[-1]
            done = {} if finished else {line["key"]: line["result"] for line in lines}
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(
                self._path, "is not a journal of results", "give another folder (-o), or remove it"
            ) from error
        if finished:
            return
        if about != self._about:
            raise InputError(
                self._path,
                "holds results of an interrupted run with other parameters or recordings",
                "give another folder (-o), or remove it",
            )
        self.done, self._length = done, len(whole)

    def _write(self, line: Mapping[str, Any]) -> None:
        if self._file is None:
            self._file = self._open()
        self._file.write(json.dumps(finite(line), allow_nan=False) + "\n")
        self._file.flush()

    def _open(self) -> TextIO:
        file = self._path.open("a", encoding="utf-8")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            file.close()
            raise InputError(
                self._path, "another run is writing to it", "give another folder (-o)"
            ) from error
        file.truncate(self._length)
        if self._length == 0:
            file.write(json.dumps(self._about) + "\n")
        return file
