"""A recording that ends early."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice, takewhile

from rgbd_glue_ros.recordings.recording import Recording
from rgbd_glue_ros.recordings.wrapped import WrappedInertialRecording
from rgbd_glue_ros.types import RgbdFrame


def first_frames(recording: Recording, count: int | None) -> Recording:
    """The first ``count`` frames of a recording; the recording itself if that is None."""
    return recording if count is None else _FirstFrames(recording, count)


@dataclass(frozen=True)
class _FirstFrames(WrappedInertialRecording):
    """A ``Recording`` of at most ``count`` frames."""

    count: int

    @property
    def frame_count(self) -> int:
        """At most that of the underlying recording."""
        return min(self.recording.frame_count, self.count)

    def __iter__(self) -> Iterator[RgbdFrame]:
        return islice(self.recording, self.count)

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        """The frames with these numbers, as far as they are among the first."""
        return self.recording.select(takewhile(lambda number: number < self.count, indices))
