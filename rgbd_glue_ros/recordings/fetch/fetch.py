"""From a source to a folder of recordings."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from urllib.parse import urlsplit

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.writing import json_text, write_whole
from rgbd_glue_ros.recordings.fetch.archive import only_folder, remove, unpack
from rgbd_glue_ros.recordings.fetch.catalogue import Source
from rgbd_glue_ros.recordings.fetch.download import Progress, download

RECORD = "fetched.json"
"""File in the folder with its origin, and size and checksum of the archive."""


@dataclass(frozen=True)
class Fetched:
    """A fetched data set.

    Attributes:
        folder: of the recordings.
        url: of the archive.
        licence: of the data.
        bytes: of the archive.
        sha256: of the archive.
    """

    folder: Path
    url: str
    licence: str
    bytes: int
    sha256: str


def fetch(
    source: Source,
    directory: Path,
    *,
    on_download: Progress = lambda *_: None,
    on_unpack: Callable[[int], None] = lambda _: None,
    pause_s: float = 2.0,
) -> Fetched:
    """Downloads and unpacks a data set; its folder appears once it is complete.

    No publisher in the catalogue gives checksums. Instead the server's certificate is trusted, and
    the checksums in gzip and zip; if ``source`` has a checksum, it is decisive. A file in
    ``directory`` with the archive's name is used and not downloaded again.

    Args:
        source: what to fetch.
        directory: parent of its folder; created if it does not exist.
        on_download: called for every block of the archive.
        on_unpack: called with the bytes of every block unpacked.
        pause_s: between attempts to resume a download.

    Raises:
        InputError: the folder exists or cannot be written, the download fails, or the archive is
            invalid.
    """
    target = directory / source.folder
    if target.exists():
        raise InputError(target, "already exists", "remove it to fetch it again")
    archive = directory / Path(urlsplit(source.url).path).name
    work = directory / f".{source.folder}.unpacking"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if not archive.is_file():
            download(source.url, archive, on_progress=on_download, pause_s=pause_s)
        checksum = _sha256(archive)
        if source.sha256 is not None and checksum != source.sha256.lower():
            archive.unlink()
            raise InputError(
                source.url, f"has the SHA-256 {checksum}, not {source.sha256}", "do not trust it"
            )
        result = Fetched(target, source.url, source.licence, archive.stat().st_size, checksum)
        try:
            remove(work)
            _unpack_or_discard(archive, work, on_unpack)
            _record(result, only_folder(work)).rename(target)
        finally:
            remove(work)
        archive.unlink()
    except OSError as error:
        raise InputError(
            directory, f"cannot be written ({error.strerror})", "give another folder (-o)"
        ) from error
    return result


def _unpack_or_discard(archive: Path, folder: Path, on_bytes: Callable[[int], None]) -> None:
    try:
        unpack(archive, folder, on_bytes)
    except InputError:
        # a damaged archive must not be used again
        archive.unlink()
        raise


def _record(fetched: Fetched, folder: Path) -> Path:
    content = {key: value for key, value in asdict(fetched).items() if key != "folder"}
    write_whole(folder / RECORD, json_text(content))
    return folder


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(2**20):
            digest.update(block)
    return digest.hexdigest()
