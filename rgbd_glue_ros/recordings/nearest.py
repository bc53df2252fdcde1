"""The closest layout of a path that is not a recording, and what is missing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import open_file, refuse_stand_in, visible

SEE = "docs/data.md lists the supported formats"

# First bytes of packed files, and their types
_ARCHIVES = (
    (b"PK\x03\x04", "a zip archive"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"BZh", "a bzip2 archive"),
    (b"\xfd7zXZ", "an xz archive"),
    (b"7z\xbc\xaf", "a 7z archive"),
    (b"\x1a\x45\xdf\xa3", "a Matroska video (.mkv)"),
)

# Maximum number of recordings that are named
_NAMED = 3


@dataclass(frozen=True)
class Layout:
    """The layout of a kind of recording.

    Attributes:
        name: name of the kind.
        parts: patterns of the files in its folder, each with its name in words; they identify the
            kind, and are reported if missing.
    """

    name: str
    parts: tuple[tuple[str, str], ...]


def _layout(name: str, *parts: str) -> Layout:
    return Layout(name, tuple((part, part) for part in parts))


LAYOUTS = (
    _layout("TUM RGB-D", "rgb.txt", "depth.txt"),
    _layout("OpenLORIS", "color.txt", "aligned_depth.txt"),
    _layout("ICL-NUIM", "associations.txt", "*.gt.freiburg"),
    _layout("7-Scenes", "frame-*.color.*", "frame-*.depth.*"),
    _layout("Replica", "results/frame*", "results/depth*"),
    _layout("Stray Scanner", "rgb.mp4", "depth/*", "camera_matrix.csv"),
    _layout("Record3D", "rgb/*", "depth/*", "metadata.json"),
    _layout("SUN3D", "image/*", "depth/*", "intrinsics.txt"),
    _layout("ScanNet", "color/*", "depth/*", "pose/*"),
    Layout("rosbag2", (("metadata.yaml", "metadata.yaml"), ("*.mcap", "the .mcap or .db3 file"))),
    _layout("a folder of images", "rgb/*", "depth/*"),
    _layout("a folder of images", "color/*", "depth/*"),
    _layout("a folder of images", "images/*", "depth/*"),
)


def explain_unknown(path: Path, recordings: Iterable[Path]) -> InputError:
    """Why a path is not a recording: the closest layout, and what is missing.

    Args:
        path: one without a known format.
        recordings: those directly below it.
    """
    if path.is_file():
        return _of_file(path)
    below = sorted(child.name for child in recordings)
    if below:
        return _of_parent(path, below)
    if not any(visible(path)):
        return InputError(
            path, "is not a recording in a known format: it is empty", "give the folder of one"
        )
    found = _nearest(path)
    return _of_other(path) if found is None else _of_incomplete(path, *found)


def _of_parent(path: Path, below: list[str]) -> InputError:
    more = " and others" if len(below) > _NAMED else ""
    return InputError(
        path,
        f"is not a recording, but holds {', '.join(below[:_NAMED])}{more}, which are",
        "give one of them",
    )


def _of_other(path: Path) -> InputError:
    held = ", ".join(sorted(child.name for child in islice(visible(path), 5)))
    return InputError(
        path,
        f"is not a recording in a known format; it holds {held}",
        f"give a bag, or a folder of colour images (rgb) beside one of depth (depth); {SEE}",
    )


def _of_incomplete(path: Path, layout: Layout, missing: list[str]) -> InputError:
    if not missing:
        return InputError(
            path,
            f"is most like {layout.name}, but its images have no numbers that show which belong "
            "together",
            "give both images of a frame the same number, or list them in associations.txt (stamp "
            f"color stamp depth); {SEE}",
        )
    remedy = f"restore {missing[0]}"
    if missing[0].endswith("/*"):
        remedy += ", or name the images (--color-topic NAME --depth-topic NAME)"
    return InputError(
        path,
        f"is not a recording in a known format; it is most like {layout.name}, but "
        f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing",
        f"{remedy}; {SEE}",
    )


def _of_file(path: Path) -> InputError:
    with open_file(path) as file:
        head = file.read(256)
    refuse_stand_in(head, path)
    kind = next((name for magic, name in _ARCHIVES if head.startswith(magic)), None)
    if path.suffix.lower() == ".r3d":
        return InputError(
            path,
            "is an archive of Record3D, whose depth is compressed with Apple's LZFSE",
            "export EXR + RGB from the app, and give that folder",
        )
    if kind is not None:
        return InputError(path, f"is {kind}", "unpack it, and give its contents")
    return InputError(
        path, "is neither a bag nor a sensor stream", f"give a bag or a folder; {SEE}"
    )


def _nearest(folder: Path) -> tuple[Layout, list[str]] | None:
    """The layout with most of its parts present, and the missing parts; None if none is present."""
    best: tuple[Layout, list[str]] | None = None
    most = 0.0
    for layout in LAYOUTS:
        missing = [said for pattern, said in layout.parts if not _is_there(folder, pattern)]
        share = 1 - len(missing) / len(layout.parts)
        if share > most:
            best, most = (layout, missing), share
    return best


def _is_there(folder: Path, pattern: str) -> bool:
    return next(visible(folder, pattern), None) is not None
