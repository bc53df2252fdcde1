"""What takes the frames of a replay and their estimates, to write them elsewhere."""

from __future__ import annotations

from typing import Protocol

from rgbd_glue_ros.types import OdometryEstimate, RgbdFrame


class FrameSink(Protocol):
    """Takes every frame with its estimate, in order."""

    def add(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Takes a frame."""

    def start_anew(self) -> None:
        """Time went back, and the odometry starts anew: the next pose is in another frame."""

    def close(self) -> None:
        """Finishes what is written; called however the replay ends."""


class LeftOpen:
    """A sink that a replay does not finish, as more is to come."""

    def __init__(self, sink: FrameSink) -> None:
        self._sink = sink

    def add(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Takes a frame."""
        self._sink.add(frame, estimate)

    def start_anew(self) -> None:
        """Starts anew."""
        self._sink.start_anew()

    def close(self) -> None:
        """Nothing: whoever opened it does."""
