"""Resumable downloads over HTTP."""

from __future__ import annotations

import http.client
import json
import logging
import shutil
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rgbd_glue_ros.errors import InputError

logger = logging.getLogger(__name__)

MAX_BYTES = 2**37
"""More than ten times the largest archive of the catalogue."""

Progress = Callable[[int, "int | None"], None]
"""Called with the bytes present and the total, None if unknown."""

_BLOCK = 2**18
_TIMEOUT_S = 30
_ATTEMPTS = 4
_PAUSE_S = 2.0
_PARTIAL, _OK, _NOT_SATISFIABLE = 206, 200, 416
_PASSING = {408, 425, 429, 500, 502, 503, 504}


def download(
    url: str,
    target: Path,
    *,
    on_progress: Progress = lambda *_: None,
    limit: int = MAX_BYTES,
    pause_s: float = _PAUSE_S,
) -> None:
    """Downloads a file; continues what an earlier run left if the file is unchanged.

    The server decides whether it is unchanged (If-Range, by the ETag or date that it gave); without
    these the download starts over. ``target`` appears only once it is complete according to the
    server; the caller has to check its content.

    Args:
        url: http or https; https is never left for http.
        target: destination; an incomplete download is in a file of this name with ``.part``.
        on_progress: called for every block.
        limit: maximum size in bytes.
        pause_s: before the first retry; it increases by as much for every further one.

    Raises:
        InputError: there is no such file, it is too large, or the server stopped several times
            without sending another byte.
    """
    part = _Part(target, url)
    failures, most = 0, part.size
    while True:
        try:
            if _attempt(part, limit, on_progress):
                break
            cause = "the connection was lost"
        except urllib.error.HTTPError as error:
            if error.code not in _PASSING:
                raise InputError(
                    url, f"{error.code} {error.reason}", "look for it there"
                ) from error
            cause = f"{error.code} {error.reason}"
        except (OSError, http.client.HTTPException) as error:
            cause = str(error) or type(error).__name__
        failures = 0 if part.size > most else failures + 1
        most = max(most, part.size)
        if failures >= _ATTEMPTS:
            raise InputError(
                url,
                f"stopped after {most} bytes ({cause})" if most else f"returned nothing ({cause})",
                "run this again to resume" if most else "check the network",
            )
        logger.info("%s: %s; resuming from byte %d", url, cause, part.size)
        time.sleep(pause_s * failures)
    part.finish()


@dataclass(frozen=True)
class _Part:
    """The partial file, and beside it what identifies the server's version."""

    target: Path
    url: str

    @property
    def path(self) -> Path:
        return self.target.with_name(self.target.name + ".part")

    @property
    def _note(self) -> Path:
        return self.target.with_name(self.target.name + ".part.json")

    @property
    def size(self) -> int:
        return self.path.stat().st_size if self.path.is_file() else 0

    @property
    def validator(self) -> str | None:
        """ETag or date of the partial file, None if it cannot be resumed."""
        try:
            note = json.loads(self._note.read_text(encoding="utf-8"))
            return str(note["validator"]) if note["url"] == self.url else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def start(self, validator: str | None) -> None:
        """Starts over."""
        self.path.write_bytes(b"")
        self._note.unlink(missing_ok=True)
        if validator is not None:
            note = {"url": self.url, "validator": validator}
            self._note.write_text(json.dumps(note), encoding="utf-8")

    def finish(self) -> None:
        self._note.unlink(missing_ok=True)
        self.path.replace(self.target)


class _StaysSecure(urllib.request.HTTPRedirectHandler):
    def redirect_request(
        self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str
    ) -> Any:
        if req.full_url.startswith("https:") and not newurl.startswith("https:"):
            raise InputError(
                req.full_url, f"redirects to {newurl}, which is not encrypted", "do not trust it"
            )
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def _attempt(part: _Part, limit: int, on_progress: Progress) -> bool:
    """One request for the missing part; returns whether the file is then complete."""
    validator = part.validator
    offset = part.size if validator else 0
    request = urllib.request.Request(part.url)  # noqa: S310 - of the catalogue or a test
    if offset and validator:
        request.add_header("Range", f"bytes={offset}-")
        request.add_header("If-Range", validator)
    opener = urllib.request.build_opener(_StaysSecure)
    try:
        response = opener.open(request, timeout=_TIMEOUT_S)
    except urllib.error.HTTPError as error:
        if error.code == _NOT_SATISFIABLE:
            # the local part is larger than the file: the file has changed
            part.start(None)
            return False
        raise
    with response:
        total = _total(response, offset)
        if response.status == _PARTIAL and _start_of(response) != offset:
            part.start(None)
            return False
        if response.status == _OK:
            offset = 0
            part.start(_validator(response.headers))
        _check_size(part, total, offset, limit)
        with part.path.open("ab") as file:
            while block := response.read(_BLOCK):
                file.write(block)
                offset += len(block)
                _check_size(part, offset, offset, limit)
                on_progress(offset, total)
    return total is None or offset == total


def _total(response: Any, offset: int) -> int | None:
    """The size of the whole file according to the server; None if it gives none."""
    length = response.headers.get("Content-Length", "")
    if not length.isdecimal():
        return None
    return int(length) + (offset if response.status == _PARTIAL else 0)


def _start_of(response: Any) -> int | None:
    """The offset at which the response begins."""
    word = response.headers.get("Content-Range", "").removeprefix("bytes ").split("-")[0]
    return int(word) if word.isdecimal() else None


def _validator(headers: Mapping[str, str]) -> str | None:
    etag = headers.get("ETag")
    # a weak ETag does not guarantee the same bytes
    return etag if etag and not etag.startswith("W/") else headers.get("Last-Modified")


def _check_size(part: _Part, total: int | None, offset: int, limit: int) -> None:
    if total is None:
        return
    if total > limit:
        part.start(None)
        raise InputError(part.url, f"has {total} bytes, more than {limit}", "do not trust it")
    free = shutil.disk_usage(part.path.parent).free
    if total - offset > free:
        raise InputError(
            part.path.parent,
            f"has {free} bytes free, and {part.url} needs {total - offset}",
            "make room",
        )
