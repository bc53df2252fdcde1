"""A recording whose images are reduced in size."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from rgbd_glue_ros.closing import uninterrupted
from rgbd_glue_ros.geometry.reduction import reduced
from rgbd_glue_ros.recordings.wrapped import WrappedInertialRecording
from rgbd_glue_ros.types import RgbdFrame


@dataclass(frozen=True)
class ReducedRecording(WrappedInertialRecording):
    """A ``Recording`` with images at most ``max_width`` pixels wide."""

    max_width: int

    def __iter__(self) -> Iterator[RgbdFrame]:
        for frame in self.recording:
            yield self._reduced(frame)

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        """The frames with these numbers, reduced."""
        for frame in self.recording.select(indices):
            yield self._reduced(frame)

    @uninterrupted()
    def _reduced(self, frame: RgbdFrame) -> RgbdFrame:
        return reduced(frame, self.max_width)
