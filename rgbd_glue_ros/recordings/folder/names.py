"""Files that are named alike, by what tells their frames: a number, or when they were taken."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from rgbd_glue_ros.files.stamp_text import stamps_ns
from rgbd_glue_ros.types import NANOSECONDS

_NUMBER = re.compile(r"\d+(?:\.\d+)?")

# Seconds since 1970 and a fraction
_STAMP = re.compile(r"\d{9,10}\.\d+")

# Redwood and SUN3D name a file by its number and when it was taken, in microseconds
_NUMBER_AND_TIME = re.compile(r"\d{5,7}-(?P<microseconds>\d{12})")

# Seconds since 1970, or since any start with all nine digits of the nanoseconds
_SECONDS = re.compile(
    r"(?<![\d.])(?:(?P<since_1970>\d{9,10})[-_](?P<fraction>\d{1,9})"
    r"|(?P<since_start>\d{1,8})[-_](?P<nanoseconds>\d{9}))(?![\d.]|x\d)"
)

_DATE = re.compile(
    r"(?<!\d)(?P<year>(?:19|20)\d\d)(?P<dash>[-_.]?)(?P<month>\d\d)(?P=dash)(?P<day>\d\d)[-_.T ]?"
    r"(?P<time>(?P<hour>\d\d)(?P<colon>[-_.:]?)(?P<minute>\d\d)(?P=colon)(?P<second>\d\d))"
    r"(?:[-_.,](?P<fraction>\d{1,9})|(?P<joined>\d{3}|\d{6}))?(?!\d)"
)
_ISO = "{year}-{month}-{day}T{hour}:{minute}:{second}+00:00"

_FIRST_STAMP = 10**8
"""Numbers from here on are seconds, or finer, since 1970 or the start of a machine."""

_DIGITS_OF_NANOSECONDS = 9


@dataclass(frozen=True)
class Stream:
    """Files of one kind, as the images of one camera.

    Attributes:
        name: as its folder and the name of a file, with # for what differs from file to file.
        files: by the number of the frame, or by its stamp in nanoseconds.
        is_stamped: whether these are stamps.
    """

    name: str
    files: Mapping[int, Path]
    is_stamped: bool


def streams_of(paths: Iterable[Path], root: Path) -> list[Stream]:
    """The streams of files below ``root``, by name; files without a number are in none."""
    alike: dict[tuple[Path, str, str], list[Path]] = defaultdict(list)
    for path in paths:
        shape, count = _NUMBER.subn("#", path.stem)
        if count:
            alike[path.parent, shape, path.suffix].append(path)
    found = [
        Stream((place / name).relative_to(root).as_posix(), stream, is_stamped)
        for (place, _, _), files in alike.items()
        for name, stream, is_stamped in _streams(files)
    ]
    return sorted(found, key=lambda stream: stream.name)


def frames_of(paths: Sequence[Path]) -> list[int | None]:
    """The number or stamp of each file's frame; None where its name tells none."""
    streams = streams_of((Path(path.name) for path in paths), Path())
    frames = {path.name: frame for stream in streams for frame, path in stream.files.items()}
    return [frames.get(path.name) for path in paths]


# A stream's name, its files by number or stamp, and whether these are stamps
_Found = tuple[str, dict[int, Path], bool]


def _streams(paths: list[Path]) -> Iterator[_Found]:
    """The streams of files whose names differ in numbers alone."""
    readings: tuple[tuple[re.Pattern[str], Callable[[list[_Match]], _Frames | None]], ...] = (
        (_NUMBER_AND_TIME, _by_microseconds),
        (_DATE, _by_date),
        (_SECONDS, _by_seconds),
    )
    for pattern, read in readings:
        matches = [pattern.search(path.stem) for path in paths]
        every = [match for match in matches if match is not None]
        if len(every) == len(paths):
            found = list(_read(paths, every, read))
            if None in found:
                found = list(_without(paths, every))
            if found and None not in found:
                yield from (stream for stream in found if stream is not None)
                return
    numbers = _telling_numbers(paths)
    yield from (stream for stream in _read(paths, numbers, _by_number) if stream is not None)


_Match = re.Match[str]
# Numbers or stamps of files, and whether they are stamps
_Frames = tuple[list[int], bool]


def _read(
    paths: list[Path], matches: list[_Match], read: Callable[[list[_Match]], _Frames | None]
) -> Iterator[_Found | None]:
    """The streams of files whose frames are told by these parts of their names.

    None stands for one that ``read`` does not understand, or whose frames it does not tell apart.
    """
    streams: dict[str, tuple[list[Path], list[_Match]]] = defaultdict(lambda: ([], []))
    for name, path, match in zip(_names(paths, matches), paths, matches, strict=True):
        streams[name][0].append(path)
        streams[name][1].append(match)
    for name, (files, parts) in streams.items():
        frames = read(parts)
        if frames is None or (frames[1] and len(set(frames[0])) < len(files)):
            yield None
        else:
            yield name, dict(zip(frames[0], files, strict=True)), frames[1]


def _without(paths: list[Path], matches: list[_Match]) -> Iterator[_Found]:
    """The streams of files by the rest of their names; none if that does not tell them apart.

    A time may be that of the run, and a number beside it the frame's.
    """
    rests = {
        path.with_name(
            f"{path.stem[: match.start()]}#{path.stem[match.end() :]}{path.suffix}"
        ): path
        for path, match in zip(paths, matches, strict=True)
    }
    if len(rests) == len(paths) and all(_NUMBER.search(rest.stem) for rest in rests):
        for name, files, is_stamped in _streams(list(rests)):
            yield name, {frame: rests[rest] for frame, rest in files.items()}, is_stamped


def _names(paths: list[Path], matches: list[_Match]) -> Iterator[str]:
    """The names of the streams of files.

    What tells the frame is replaced by #, and so are other numbers that differ with it, as of a
    clock of the camera; numbers with a few values tell cameras, or sizes.
    """
    around = [
        (path.stem[: match.start()], path.stem[match.end() :])
        for path, match in zip(paths, matches, strict=True)
    ]
    others = zip(*([*map(_NUMBER.findall, sides)] for sides in around), strict=True)
    are_kept = [
        [2 * len(set(column)) <= len(paths) for column in zip(*rows, strict=False)]
        for rows in others
    ]
    for path, sides in zip(paths, around, strict=True):
        before, after = (_masked(text, kept) for text, kept in zip(sides, are_kept, strict=True))
        yield f"{before}#{after}{path.suffix}"


def _masked(text: str, are_kept: list[bool]) -> str:
    """A text with # for each of its numbers that is not kept."""
    kept = iter(are_kept)
    return _NUMBER.sub(lambda number: number.group() if next(kept, False) else "#", text)


def _telling_numbers(paths: list[Path]) -> list[_Match]:
    """The number in each name that differs from file to file: a stamp, or else the last one.

    With it the files are in as few streams as possible.
    """
    columns = list(zip(*(_NUMBER.finditer(path.stem) for path in paths), strict=True))
    texts = [[number.group() for number in column] for column in columns]
    stamped = [i for i, column in enumerate(texts) if all(map(_STAMP.fullmatch, column))]
    if len(stamped) == 1:
        return list(columns[stamped[0]])

    def stream_count(at: int) -> int:
        others = [column for i, column in enumerate(texts) if i != at]
        return len(set(zip(*others, strict=True))) if others else 1

    return list(columns[min(reversed(range(len(columns))), key=stream_count)])


def _by_number(numbers: list[_Match]) -> _Frames | None:
    texts = [number.group() for number in numbers]
    if not all("." in text or int(text) >= _FIRST_STAMP for text in texts):
        return [int(text.partition(".")[0]) for text in texts], False
    try:
        return stamps_ns(texts), True
    except ValueError:
        return None  # too large for a stamp


def _by_microseconds(matches: list[_Match]) -> _Frames | None:
    whole = all(match.group() == match.string for match in matches)
    return ([1000 * int(match["microseconds"]) for match in matches], True) if whole else None


def _by_date(dates: list[_Match]) -> _Frames | None:
    """Stamps of dates in UTC."""
    fractions = [date["fraction"] or date["joined"] or "" for date in dates]
    times = [date["time"] for date in dates]
    if not any(fractions) and all(map(str.isdigit, times)) and min(map(int, times)) <= 1:
        return None  # a day, and the numbers of frames
    try:
        moments = [datetime.fromisoformat(_ISO.format(**date.groupdict())) for date in dates]
    except ValueError:
        return None  # there is no 32nd of May
    return _by_fraction([int(moment.timestamp()) for moment in moments], fractions)


def _by_seconds(matches: list[_Match]) -> _Frames | None:
    seconds = [int(match["since_1970"] or match["since_start"]) for match in matches]
    is_number = all(match["since_start"] for match in matches) and len(set(seconds)) > 2
    if is_number and len(set(seconds)) == len(seconds):
        return None  # a number of each frame, and some other one
    return _by_fraction(seconds, [match["fraction"] or match["nanoseconds"] for match in matches])


def _by_fraction(seconds: list[int], fractions: list[str]) -> _Frames:
    """Stamps of seconds and their fractions, as decimals or as whole milli-, micro-, nanoseconds.

    Numbers that grow by one, whatever the second, are those of frames.
    """
    numbers = [int(fraction or 0) for fraction in fractions]
    in_order = [number for _, number in sorted(zip(seconds, numbers, strict=True))]
    if len(numbers) > 1 and np.median(np.diff(in_order)) == 1:
        return numbers, False
    widths = {len(fraction) for fraction in fractions if fraction} or {0}
    # of one width they are decimals; otherwise zeros in front were left out
    digits = max(widths) if len(widths) == 1 else 3 * -(-max(widths) // 3)
    unit = 10 ** (_DIGITS_OF_NANOSECONDS - digits)
    pairs = zip(seconds, numbers, strict=True)
    return [second * NANOSECONDS + number * unit for second, number in pairs], True
