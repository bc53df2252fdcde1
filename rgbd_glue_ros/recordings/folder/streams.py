"""Numbered or stamped image files: which are colour or depth, and which belong together.

Files of a stream share a folder, and a name except for a number in it.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.stamp_text import stamps_ns
from rgbd_glue_ros.recordings.frame_times import frame_stamp_ns
from rgbd_glue_ros.recordings.image_sequence import IMAGE_TYPES, ImagePair, ImagePairs
from rgbd_glue_ros.recordings.left_out import COLOR, DEPTH
from rgbd_glue_ros.trajectories.association import associate

# Names of a folder in a recording with both images; others are separate recordings
_BOTH = re.compile(r"results?|data|images?|frames|rgbd|cam(era)?_?\d*", re.I)

_COLOR = re.compile(r"rgb|colou?r|(?<![a-z])images?(?![a-z])|frames?|(?<![a-z])left(?![a-z])", re.I)
_DEPTH = re.compile(r"depth|(?<![a-z])d(?![a-z])", re.I)
_REGISTERED = re.compile(r"align|regist|_to_|filtered", re.I)
_OTHER = re.compile(
    r"conf|mask|label|semantic|instance|segm|normal|infra|thermal|vis|flow|preview|thumb"
    r"|(?<![a-z])(ir|right|calib\w*|debug)(?![a-z])",
    re.I,
)
_NUMBER = re.compile(r"\d+(?:\.\d+)?")

# Seconds since 1970 and a fraction
_STAMP = re.compile(r"\d{9,10}\.\d+")

# Redwood and SUN3D name a file by its number and when it was taken, in microseconds
_NUMBER_AND_TIME = re.compile(r"(\d{5,7})-(\d{12})")

_FIRST_STAMP = 10**8
"""Numbers from here on are seconds, or finer, since 1970 or the start of a machine."""


@dataclass(frozen=True)
class Stream:
    """Images of one camera.

    Attributes:
        name: as its folder and the name of a file, with # for the number.
        files: by the number in their names, as text.
    """

    name: str
    files: Mapping[str, Path]


def streams_in(folder: Path) -> list[Stream]:
    """The streams of images in a folder and those directly below."""
    found: dict[str, dict[str, Path]] = defaultdict(dict)
    for path in _images(folder):
        numbers = list(_NUMBER.finditer(path.stem))
        if not numbers:
            continue
        timed = _NUMBER_AND_TIME.fullmatch(path.stem)
        stamps = [number for number in numbers if _STAMP.fullmatch(number.group())]
        if timed:
            key, name = timed.group(), "#"
        elif len(stamps) == 1:
            # what other numbers there are, as of a clock of the camera, differ too
            key, name = stamps[0].group(), _NUMBER.sub("#", path.stem)
        else:
            start, end = numbers[-1].span()
            key, name = numbers[-1].group(), f"{path.stem[:start]}#{path.stem[end:]}"
        name += path.suffix
        found[(path.parent / name).relative_to(folder).as_posix()][key] = path
    streams = [Stream(name, files) for name, files in sorted(found.items())]
    return [stream for stream in streams if not _is_of_another(stream, streams)]


def _images(folder: Path) -> Iterator[Path]:
    for path in folder.iterdir():
        if path.suffix.lower() in IMAGE_TYPES:
            yield path
        elif path.is_dir() and not path.name.startswith("."):
            yield from (p for p in path.iterdir() if p.suffix.lower() in IMAGE_TYPES)


def _is_of_another(stream: Stream, streams: list[Stream]) -> bool:
    """Whether a stream is in a folder that is a separate recording."""
    place, _, _ = stream.name.rpartition("/")
    if not place or _BOTH.fullmatch(place):
        return False
    beside = [s.name.rpartition("/")[2] for s in streams if s.name.startswith(f"{place}/")]
    depth = [bool(_DEPTH.search(name)) for name in beside]
    return any(depth) and not all(depth)


def color_and_depth(
    folder: Path, wanted_color: str | None, wanted_depth: str | None
) -> tuple[Stream, Stream] | None:
    """The streams of colour and depth images in a folder; None if there is not one of each.

    Args:
        folder: of the recording.
        wanted_color: part of the name of the colour stream; None finds it by name.
        wanted_depth: part of the name of the depth stream; None finds it by name.

    Raises:
        InputError: several streams may be one of them, or the wanted one does not exist.
    """
    streams = streams_in(folder)
    depth = _chosen(folder, streams, "depth", wanted_depth)
    if depth is None:
        return None
    color = _chosen(folder, [s for s in streams if s is not depth], "color", wanted_color)
    return None if color is None else (color, depth)


def _chosen(folder: Path, streams: list[Stream], what: str, wanted: str | None) -> Stream | None:
    if wanted is not None:
        found = [s for s in streams if wanted.strip("/") in s.name]
    elif what == "depth":
        found = [s for s in streams if _DEPTH.search(s.name) and not _OTHER.search(s.name)]
        found = [s for s in found if _REGISTERED.search(s.name)] or found
    else:
        found = [s for s in streams if not (_DEPTH.search(s.name) or _OTHER.search(s.name))]
        found = [s for s in found if _COLOR.search(s.name)] or found
    if not found and (wanted is None or not streams):
        return None
    if len(found) == 1:
        return found[0]
    names = ", ".join(f"{s.name} ({len(s.files)})" for s in found or streams)
    cause = f"{len(found)} kinds of images may be {what}: {names}"
    if not found:
        cause = f"no images of {wanted}; there are {names}"
    raise InputError(folder, cause, f"give one of them (--{what}-topic NAME)")


def paired(folder: Path, color: Stream, depth: Stream) -> ImagePairs:
    """The frames of two streams: by the numbers in the names, or by time if these are stamps.

    Raises:
        InputError: no images belong together.
    """
    color_ns, depth_ns = _stamps(color), _stamps(depth)
    color_files, depth_files = list(color.files.values()), list(depth.files.values())
    if color_ns is None or depth_ns is None:
        pairs = _by_number(color, depth)
    else:
        rows = zip(
            *associate(np.array(color_ns, np.int64), np.array(depth_ns, np.int64)), strict=True
        )
        pairs = [
            ImagePair(color_ns[i], color_files[i], depth_ns[j], depth_files[j]) for i, j in rows
        ]
    if not pairs:
        raise InputError(
            folder,
            f"no image of {color.name} has the number of one of {depth.name}",
            "give both images of a frame the same number, or list them in associations.txt "
            "(stamp color stamp depth)",
        )
    images = {COLOR: len(color_files), DEPTH: len(depth_files)}
    return ImagePairs.of(sorted(pairs, key=lambda pair: pair.stamp_ns), images, 0)


def _by_number(color: Stream, depth: Stream) -> list[ImagePair]:
    colors = {_whole(text): path for text, path in color.files.items()}
    depths = {_whole(text): path for text, path in depth.files.items()}
    if not colors.keys() & depths.keys() and len(colors) == len(depths):
        # for example if one counts from 0 and the other continues after it
        depths = dict(zip(sorted(colors), (depths[n] for n in sorted(depths)), strict=True))
    return [
        ImagePair(frame_stamp_ns(n), colors[n], frame_stamp_ns(n), depths[n])
        for n in sorted(colors.keys() & depths.keys())
    ]


def _whole(text: str) -> int:
    return int(text.partition(".")[0].partition("-")[0])


def _stamps(stream: Stream) -> list[int] | None:
    """When the images were taken; None if their names contain numbers of frames."""
    texts = list(stream.files)
    timed = [_NUMBER_AND_TIME.fullmatch(text) for text in texts]
    if all(timed):
        return [1000 * int(match[2]) for match in timed if match]
    if any(timed) or not all("." in text or int(text) >= _FIRST_STAMP for text in texts):
        return None
    return stamps_ns(texts)
