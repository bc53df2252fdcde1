"""Whether the odometry's memory stays constant over hours of frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from typing import Any

from rgbd_glue_ros.experiments.report.machine import resident_mb
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.recordings import Recording
from rgbd_glue_ros.types import NANOSECONDS, RgbdFrame

_EVERY = 50


class Memory:
    """A ``Part``: one odometry over an endlessly repeated recording.

    The memory of the process is measured, including reading the recording and all libraries, so
    this part comes before any that loads a peer.
    """

    title = "memory"

    def __init__(self, recording: Recording, config: Config, frames: int) -> None:
        """Prepares the measurement.

        Args:
            recording: the frames.
            config: of the odometry.
            frames: when to stop.
        """
        self._recording = recording
        self._config = config
        self.frame_count = frames
        self._frames: list[int] = []
        self._resident_mb: list[float] = []

    def run(self, step: Callable[[], None]) -> None:
        """Runs the odometry, sampling the memory."""
        with Odometry(self._config) as odometry:
            for i, frame in enumerate(islice(endless(self._recording), self.frame_count), 1):
                odometry.process(frame)
                if i % _EVERY == 0 or i == self.frame_count:
                    self._frames.append(i)
                    self._resident_mb.append(resident_mb())
                step()

    def figures(self) -> dict[str, Any]:
        """The curve: megabytes by number of frames."""
        return {
            "memory": {
                "recording": self._recording.name,
                "frames": self._frames,
                "resident_mb": self._resident_mb,
            }
        }


def endless(recording: Recording) -> Iterator[RgbdFrame]:
    """The frames repeated endlessly, with stamps that continue at the same pace."""
    offset_ns = 0
    while True:
        first_ns = last_ns = before_ns = None
        for frame in recording:
            stamp_ns = frame.stamp_ns + offset_ns
            first_ns = stamp_ns if first_ns is None else first_ns
            before_ns, last_ns = last_ns, stamp_ns
            yield replace(frame, stamp_ns=stamp_ns)
        if first_ns is None or last_ns is None:
            return
        period_ns = NANOSECONDS // 30 if before_ns is None else last_ns - before_ns
        offset_ns += last_ns - first_ns + period_ns
