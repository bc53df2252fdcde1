"""Numbered or stamped image files: which are colour or depth, and which belong together."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import visible
from rgbd_glue_ros.recordings.folder.names import Stream, streams_of
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
    r"conf|mask|label|semantic|instance|segm|normal|thermal|vis|flow|preview|thumb"
    r"|(?<![a-z])(right|calib\w*|debug)(?![a-z])",
    re.I,
)
_INFRARED = re.compile(r"infra|(?<![a-z])ir(?![a-z])", re.I)
# Of a pair of cameras, depth is in the view of the left one
_SECOND = re.compile(r"(infra(red)?|ir)_?2", re.I)

# Numbers of images are without gaps if more than this share of them is there
_WITHOUT_GAPS = 0.9
# At the end of a recording, fewer images of one kind than of the other by this factor, and by more
# than this many, are of another rate
_OTHER_RATE, _A_FEW = 1.5, 3

# Of kinds of images that are ambiguous, this many are named
_NAMED = 6


def streams_in(folder: Path) -> list[Stream]:
    """The streams of images in a folder and those directly below."""
    streams = streams_of(_images(folder), folder)
    others = _other_recordings(streams)
    return [stream for stream in streams if _place(stream) not in others]


def _images(folder: Path) -> Iterator[Path]:
    for path in visible(folder):
        if path.suffix.lower() in IMAGE_TYPES:
            yield path
        elif path.is_dir():
            yield from (p for p in visible(path) if p.suffix.lower() in IMAGE_TYPES)


def _other_recordings(streams: list[Stream]) -> set[str]:
    """The folders of streams that are separate recordings."""
    are_depth = defaultdict(set)
    for stream in streams:
        are_depth[_place(stream)].add(bool(_DEPTH.search(stream.name.rpartition("/")[2])))
    return {
        place
        for place, found in are_depth.items()
        if place and not _BOTH.fullmatch(place) and len(found) > 1
    }


def _place(stream: Stream) -> str:
    """The folder of a stream, below that of the recording."""
    return stream.name.rpartition("/")[0]


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
        found = [s for s in _of_cameras(streams) if _DEPTH.search(s.name)]
        found = [s for s in found if not _INFRARED.search(s.name)]
        found = [s for s in found if _REGISTERED.search(s.name)] or found
    else:
        views = [s for s in _of_cameras(streams) if not _DEPTH.search(s.name)]
        found = [s for s in views if not _INFRARED.search(s.name)]
        found = [s for s in found if _COLOR.search(s.name)] or found
        found = found or [s for s in views if not _SECOND.search(s.name)]
    if not found and (wanted is None or not streams):
        return None
    if len(found) == 1:
        return found[0]
    names = named(found or streams)
    cause = f"{len(found)} kinds of images may be {what}: {names}"
    if not found:
        cause = f"no images of {wanted}; there are {names}"
    raise InputError(folder, cause, f"give one of them (--{what}-topic NAME)")


def _of_cameras(streams: list[Stream]) -> list[Stream]:
    """Those that are no pictures of other things, as confidences or labels."""
    return [stream for stream in streams if not _OTHER.search(stream.name)]


def named(streams: list[Stream]) -> str:
    """The names of streams in words, each with the number of its images; not all of very many."""
    names = [f"{stream.name} ({len(stream.files)})" for stream in streams]
    more = f" and {len(names) - _NAMED} others" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def paired(folder: Path, color: Stream, depth: Stream) -> ImagePairs:
    """The frames of two streams: by the numbers in the names, or by time if these are stamps.

    Raises:
        InputError: no images belong together, or their numbers do not tell which.
    """
    if color.is_stamped and depth.is_stamped:
        pairs = _by_time(color, depth)
    else:
        _refuse_numbers_of_other_rates(folder, color, depth)
        pairs = _by_number(color, depth)
    if not pairs:
        raise InputError(
            folder,
            f"no image of {color.name} has the number of one of {depth.name}",
            "give both images of a frame the same number, or list them in associations.txt "
            "(stamp color stamp depth)",
        )
    images = {COLOR: len(color.files), DEPTH: len(depth.files)}
    return ImagePairs.of(sorted(pairs, key=lambda pair: pair.stamp_ns), images, 0)


def _by_time(color: Stream, depth: Stream) -> list[ImagePair]:
    color_ns, depth_ns = list(color.files), list(depth.files)
    rows = zip(*associate(np.array(color_ns, np.int64), np.array(depth_ns, np.int64)), strict=True)
    times = [(color_ns[i], depth_ns[j]) for i, j in rows]
    return [ImagePair(c, color.files[c], d, depth.files[d]) for c, d in times]


def _refuse_numbers_of_other_rates(folder: Path, color: Stream, depth: Stream) -> None:
    """Refuses images of two rates, where each kind counts its own."""
    fewer, more = sorted((color, depth), key=lambda stream: len(stream.files))
    spans = [max(stream.files) - min(stream.files) + 1 for stream in (fewer, more)]
    are_whole = [
        len(stream.files) > _WITHOUT_GAPS * span
        for stream, span in zip((fewer, more), spans, strict=True)
    ]
    begin_alike = abs(min(fewer.files) - min(more.files)) <= 1
    if not (all(are_whole) and begin_alike):
        return
    if spans[1] >= _OTHER_RATE * spans[0] and spans[1] - spans[0] > _A_FEW:
        raise InputError(
            folder,
            f"{more.name} has {spans[1] / spans[0]:.3g} times as many images as {fewer.name} "
            f"({len(more.files)} and {len(fewer.files)}), and both count from the same number, so "
            "they seem to be numbered apart, at two rates",
            "list those that belong together in associations.txt (stamp color stamp depth), or, if "
            f"the last ones are missing, remove those of {more.name} after {max(fewer.files)}",
        )


def _by_number(color: Stream, depth: Stream) -> list[ImagePair]:
    colors, depths = color.files, depth.files
    if not colors.keys() & depths.keys() and len(colors) == len(depths):
        # for example if one counts from 0 and the other continues after it
        depths = dict(zip(sorted(colors), (depths[n] for n in sorted(depths)), strict=True))
    times = {n: n if color.is_stamped else frame_stamp_ns(n) for n in colors}
    return [
        ImagePair(times[n], colors[n], times[n], depths[n])
        for n in sorted(colors.keys() & depths.keys())
    ]
