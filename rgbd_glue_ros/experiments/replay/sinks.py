"""Receivers of the frames of a replay and their estimates, which write them elsewhere."""

from __future__ import annotations

from typing import Protocol

from rgbd_glue_ros.types import OdometryEstimate, RgbdFrame


class FrameSink(Protocol):
    """Receives every frame with its estimate, in order."""

    def add(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Adds a frame."""

    def start_anew(self) -> None:
        """Time went back, and the odometry starts anew: the next pose is in another frame."""

    def close(self) -> None:
        """Completes the output; called however the replay ends."""


class LeftOpen:
    """A sink that a replay does not close, since more follows."""

    def __init__(self, sink: FrameSink) -> None:
        self._sink = sink

    def add(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Adds a frame."""
        self._sink.add(frame, estimate)

    def start_anew(self) -> None:
        """Starts anew."""
        self._sink.start_anew()

    def close(self) -> None:
        """Does nothing: its owner closes it."""
