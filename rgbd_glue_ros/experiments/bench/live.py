"""The node at camera rate: the recording arrives over DDS from another process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rgbd_glue_ros.experiments.demo.demo import PRESET, Progress, demo
from rgbd_glue_ros.experiments.demo.played import PlayedBag
from rgbd_glue_ros.parameters import Config, load_preset, values
from rgbd_glue_ros.recordings import Recording
from rgbd_glue_ros.recordings.bag.writer import RAW, BagWriter
from rgbd_glue_ros.recordings.convert import write_bag

_KEPT = (
    "frames",
    "lost",
    "dropped",
    "node_latency_ms",
    "latency_ms",
    "peak_rss_mb",
    "ape",
    "rpe",
)


class Live:
    """A ``Part``: plays a recording, as raw images and at its own rate, to the node."""

    title = "live"

    def __init__(self, recording: Recording, config: Config) -> None:
        self._recording = recording
        preset = values(load_preset(PRESET))
        self._parameters = {
            name: value for name, value in values(config).items() if value != preset[name]
        }
        self._figures: dict[str, Any] = {}

    @property
    def frame_count(self) -> int:
        """Frames of the recording."""
        return self._recording.frame_count

    def run(self, step: Callable[[], None]) -> None:
        """Writes the recording to a temporary bag, and plays that.

        Raises:
            MissingExtraError: ROS is not installed.
            RuntimeError: the node ended, or gave no pose.
        """
        played = 0

        def show(progress: Progress) -> None:
            nonlocal played
            while played < progress.played:
                played += 1
                step()

        with TemporaryDirectory(prefix="rgbd_glue_bench_") as folder:
            bag = Path(folder) / "bag"
            with BagWriter(bag, RAW) as writer:
                write_bag(self._recording, self._recording.ground_truth, writer)
            played_bag, out = PlayedBag.load(bag), Path(folder) / "out"
            result = demo(played_bag, out, 1.0, show, parameters=self._parameters)
        kept = {name: result.figures[name] for name in _KEPT if name in result.figures}
        self._figures = {**kept, "ready_s": result.ready_s}

    def figures(self) -> dict[str, Any]:
        """The node's results, its latency from receipt to publication, and when it was ready."""
        return {"live": self._figures} if self._figures else {}
