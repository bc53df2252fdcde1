"""A recording that ends early."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice, takewhile

from rgbd_glue_ros.recordings.recording import Recording, imu_of
from rgbd_glue_ros.recordings.wrapped import WrappedRecording
from rgbd_glue_ros.types import ImuSamples, RgbdFrame


def first_frames(recording: Recording, count: int | None) -> Recording:
    """The first ``count`` frames of a recording; the recording itself if that is None."""
    return recording if count is None else _FirstFrames(recording, count)


@dataclass(frozen=True)
class _FirstFrames(WrappedRecording):
    """A ``Recording`` of at most ``count`` frames."""

    count: int

    @property
    def frame_count(self) -> int:
        """At most that of the underlying recording."""
        return min(self.recording.frame_count, self.count)

    @property
    def imu(self) -> ImuSamples | None:
        """All samples of the underlying recording."""
        return imu_of(self.recording)

    def __iter__(self) -> Iterator[RgbdFrame]:
        return islice(self.recording, self.count)

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        """The frames with these numbers, as far as they are among the first."""
        return self.recording.select(takewhile(lambda number: number < self.count, indices))
