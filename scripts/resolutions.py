"""Measures the odometry at several sizes of images, as they come and reduced: two tables.

The bundled recording is resized and played over DDS from one process into the node in another, as
raw images (rgb8, 16UC1) and at its own 30 Hz: ``python scripts/resolutions.py``. The processor time
of a frame is measured apart, without ROS, and says something on a busy machine too
(``--processor-time`` alone).
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import process_time
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np

from rgbd_glue_ros import Odometry, RgbdFrame, Trajectory, load_preset, open_recording
from rgbd_glue_ros.experiments.demo.demo import DemoResult, bundled_bag, demo
from rgbd_glue_ros.experiments.demo.played import PlayedMessage, Stream
from rgbd_glue_ros.experiments.report.colophon import machine_text
from rgbd_glue_ros.experiments.report.machine import load, machine
from rgbd_glue_ros.experiments.report.markdown import NOTHING, table
from rgbd_glue_ros.geometry.reduction import reduced
from rgbd_glue_ros.messages.making import millimetre_image
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.odometry.warm_up import warm_up
from rgbd_glue_ros.recordings.bag.writer import INFO_TYPE, RAW, encode_frame

SIZES = ((320, 240), (640, 480), (848, 480), (1280, 720), (1920, 1080))
REDUCED_TO = 640
# what most drivers publish
CODEC = replace(RAW, depth=millimetre_image)
# frames whose processor time is taken
TIMED = 40


class Resized:
    """Frames of another size as messages in memory; a ``Played``."""

    types: Mapping[Stream, str] = MappingProxyType(
        {Channel.INFO: INFO_TYPE, Channel.COLOR: RAW.type, Channel.DEPTH: RAW.type}
    )

    def __init__(self, frames: Iterable[RgbdFrame], width: int, height: int) -> None:
        self.name = f"{width}x{height}"
        self.ground_truth: Trajectory | None = None
        self.messages: list[PlayedMessage] = []
        for frame in frames:
            encoded = encode_frame(resized(frame, width, height), CODEC)
            for channel, data in (
                (Channel.INFO, encoded.info),
                (Channel.COLOR, encoded.color),
                (Channel.DEPTH, encoded.depth),
            ):
                stamp_ns = encoded.stamp_ns
                self.messages.append(PlayedMessage(channel, stamp_ns, stamp_ns, bytes(data)))
        self.frame_count = len(self.messages) // 3

    def sample(self, _count: int) -> list[RgbdFrame]:
        """None: nobody looks at them."""
        return []


def resized(frame: RgbdFrame, width: int, height: int) -> RgbdFrame:
    """A frame with images of another size."""
    color = cv2.resize(frame.color, (width, height), interpolation=cv2.INTER_LINEAR)
    depth = cv2.resize(frame.depth, (width, height), interpolation=cv2.INTER_NEAREST)
    camera = frame.intrinsics.scaled(width, height)
    return replace(
        frame, color=color.astype(np.uint8), depth=depth.astype(np.float32), intrinsics=camera
    )


def measured(played: Resized, max_width: int) -> DemoResult:
    """What the node made of the frames."""
    parameters = {"max_width": max_width}
    with TemporaryDirectory() as folder:
        return demo(played, Path(folder), 1.0, lambda _: None, parameters=parameters)


def cells(result: DemoResult) -> list[str]:
    """Frames processed, and latency."""
    figures: dict[str, Any] = result.figures
    latency = figures["node_latency_ms"]
    return [
        f"{figures['frames']} of {figures['played']}",
        f"{latency['p50']:.0f}, {latency['p95']:.0f} ms",
    ]


def processor_ms(frames: Iterable[RgbdFrame], max_width: int) -> float:
    """The median processor time of a frame, all threads together, from images to pose and map."""
    times = []
    with Odometry(load_preset("live")) as odometry:
        for frame in frames:
            start = process_time()
            odometry.process(reduced(frame, max_width))
            times.append(1000 * (process_time() - start))
    return median(times)


def processor_times(frames: Sequence[RgbdFrame]) -> str:
    """The table of processor times."""
    warm_up(load_preset("live"))
    rows = []
    for width, height in SIZES:
        some = [resized(frame, width, height) for frame in frames[:TIMED]]
        as_it_is = f"{processor_ms(some, 0):.0f} ms"
        is_reduced = width > REDUCED_TO
        small = f"{processor_ms(some, REDUCED_TO):.0f} ms" if is_reduced else NOTHING
        rows.append([f"{width}x{height}", as_it_is, small])
    return table(["images", "processor time of a frame", f"`max_width:={REDUCED_TO}`"], rows)


def live(frames: Sequence[RgbdFrame]) -> str:
    """The table of the node over DDS."""
    rows = []
    for width, height in SIZES:
        played = Resized(frames, width, height)
        as_it_is = measured(played, 0)
        reduced = cells(measured(played, REDUCED_TO)) if width > REDUCED_TO else [NOTHING] * 2
        rows.append([played.name, *cells(as_it_is), *reduced])
        print(rows[-1], file=sys.stderr)
    head = ["images", "processed", "latency p50, p95"]
    head += [f"`max_width:={REDUCED_TO}`: processed", "latency p50, p95"]
    return table(head, rows)


def main() -> None:
    """Measures, and prints the tables."""
    with open_recording(bundled_bag()) as recording:
        frames = list(recording)
    before = load()
    print(processor_times(frames), end="\n\n")
    if "--processor-time" not in sys.argv:
        print(live(frames), end="\n\n")
    print(f"{machine_text(machine())}; processes that wanted to run: {before:.1f} to {load():.1f}")


if __name__ == "__main__":
    main()
