"""Folders of many recordings, and the splits of data sets that results are published for."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations
from pathlib import Path

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import read_text, visible
from rgbd_glue_ros.recordings.bag.layout import storage_files
from rgbd_glue_ros.recordings.formats import format_of
from rgbd_glue_ros.recordings.sens import SUFFIX

logger = logging.getLogger(__name__)

# <data set>/<split>/scans/<scan>; whoever keeps them deeper names a folder further down
_DEPTH = 4

SPLITS: Mapping[str, frozenset[str]] = {
    "3dmatch-test": frozenset(
        {
            "7-scenes-redkitchen",
            "sun3d-home_at-home_at_scan1_2013_jan_1",
            "sun3d-home_md-home_md_scan9_2012_sep_30",
            "sun3d-hotel_uc-scan3",
            "sun3d-hotel_umd-maryland_hotel1",
            "sun3d-hotel_umd-maryland_hotel3",
            "sun3d-mit_76_studyroom-76-1studyroom2",
            "sun3d-mit_lab_hj-lab_hj_tea_nov_2_2012_scan1_erika",
        }
    ),
    "7-scenes-test": frozenset(
        f"{scene}/seq-{number:02d}"
        for scene, numbers in {
            "chess": (3, 5),
            "fire": (3, 4),
            "heads": (1,),
            "office": (2, 6, 7, 9),
            "pumpkin": (1, 7),
            "redkitchen": (3, 4, 6, 12, 14),
            "stairs": (1, 4),
        }.items()
        for number in numbers
    ),
    "scannet-v2-test": frozenset(f"scene{number:04d}_00" for number in range(707, 807)),
}
"""Official splits by the names of their folders. ScanNet's first, which UR&R and BYOC use, is a
file of names in ScanNet's repository (``Tasks/Benchmark/scannetv1_test.txt``)."""


def recordings(paths: Iterable[Path], only: frozenset[str] | None = None) -> list[Path]:
    """The recordings at and below the paths, in order of their names below each.

    Args:
        paths: recordings, or folders of them; anything else is returned for the opener to refuse.
        only: names of folders to restrict these to, as returned by ``split``; None takes all.

    Raises:
        InputError: nothing remains.
    """
    found = [recording for path in paths for recording in (_below(path, _DEPTH) or [path])]
    chosen = [path for path in found if only is None or not only.isdisjoint(_names(path))]
    if not chosen:
        raise InputError(
            "--only",
            f"names none of the {len(found)} recordings, such as {found[0].name}",
            "give the data set that the names belong to",
        )
    once = {path.absolute(): path for path in reversed(chosen)}
    if len(once) < len(chosen):
        counts = Counter(path.absolute() for path in chosen)
        again = [str(once[path]) for path, count in counts.items() if count > 1]
        logger.warning("%s: given more than once, taken once", ", ".join(again))
    return [once[path] for path in dict.fromkeys(path.absolute() for path in chosen)]


def split(name: str) -> frozenset[str]:
    """The names of an official split, or those in a file with one name per line.

    Raises:
        InputError: there is no such split or file.
    """
    if name in SPLITS:
        return SPLITS[name]
    try:
        lines = read_text(Path(name)).splitlines()
    except InputError as error:
        raise InputError(
            name,
            "is neither a split nor a file of names",
            f"give a file, or one of {', '.join(SPLITS)}",
        ) from error
    names = frozenset(line.strip() for line in lines if line.strip())
    if not names:
        raise InputError(name, "holds no names", "give the names of recordings, one per line")
    return names


def _below(path: Path, depth: int) -> list[Path]:
    if format_of(path) is not None:
        return [path]
    if depth == 0 or not path.is_dir():
        return []
    return [found for child in sorted(_candidates(path)) for found in _below(child, depth - 1)]


def _candidates(folder: Path) -> Iterator[Path]:
    bags = set(storage_files(folder))
    for child in visible(folder):
        if child.is_dir() or child.suffix == SUFFIX or child in bags:
            yield child


def _names(path: Path) -> set[str]:
    """The possible names of a recording: its last folders, and each with those inside it."""
    full = path.absolute()
    last = (full.with_suffix("") if path.is_file() else full).parts[-3:]
    return {"/".join(last[i:j]) for i, j in combinations(range(len(last) + 1), 2)}
