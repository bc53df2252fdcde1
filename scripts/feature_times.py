"""Times visual features: ``python scripts/feature_times.py RECORDING [NAME...]``.

A table of the time that a frame takes and the time that a match of two frames takes, by the number
of keypoints: time of the processor, the median of several, so that other work counts little.
Features whose weights are not here are left out.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from functools import partial
from itertools import islice

import cv2

from rgbd_glue_ros import open_recording
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.report import markdown
from rgbd_glue_ros.features import VISUAL
from rgbd_glue_ros.features.weights import require
from rgbd_glue_ros.geometry.views import grey
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.types import View

KEYPOINTS = 512, 1024, 2048
REPEATS = 5
# two frames as far apart as pairs are that are to be registered
APART = 20


def main() -> None:
    """Prints the table."""
    if len(sys.argv) < 2:
        sys.exit("usage: python scripts/feature_times.py RECORDING [NAME...]")
    source, *names = sys.argv[1:]
    cv2.setNumThreads(1)
    frames = islice(open_recording(source), 0, APART + 1, APART)
    views = [View(grey(f.color), f.depth, f.intrinsics) for f in frames]
    aliases = {"none", "lightglue"}
    rows = []
    for name in names or [name for name in VISUAL if name not in aliases]:
        try:
            require(FeaturesConfig(visual=name, geometric="none"))
        except InputError as missing:
            print(missing, file=sys.stderr)
            continue
        rows.append([name, *times(name, views)])
    counts = (f"match of {count}" for count in KEYPOINTS)
    print(markdown.table(["features.visual", "frame", *counts], rows))


def times(name: str, views: list[View]) -> list[str]:
    """Milliseconds of a frame, and of a match for each number of keypoints."""
    figures: list[str] = []
    for count in KEYPOINTS:
        config = FeaturesConfig(visual=name, keypoints=count, matcher_keypoints=count, device="cpu")
        feature = VISUAL[name](config)
        source, target = (feature.extract(view) for view in views)
        if not figures:
            figures.append(milliseconds(partial(feature.extract, views[0])))
        found = (len(source.uv) + len(target.uv)) // 2
        fewer = "" if found >= count else f" ({found} found)"
        figures.append(milliseconds(partial(feature.match, source, target)) + fewer)
    return figures


def milliseconds(work: Callable[[], object]) -> str:
    """The median of a few."""
    work()
    durations = []
    for _ in range(REPEATS):
        start = time.process_time()
        work()
        durations.append(time.process_time() - start)
    median_ms = 1e3 * statistics.median(durations)
    return f"{median_ms:.0f}" if median_ms >= 10 else f"{median_ms:.1f}"


if __name__ == "__main__":
    main()
