"""A recording whose images are smaller than they were recorded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.geometry.reduction import reduced
from rgbd_glue_ros.recordings.recording import Recording, imu_of
from rgbd_glue_ros.types import ImuSamples, RgbdFrame, Trajectory


@dataclass(frozen=True)
class ReducedRecording(Closing):
    """A ``Recording`` with images of at most ``max_width`` pixels of width."""

    recording: Recording
    max_width: int

    @property
    def name(self) -> str:
        """That of the recording."""
        return self.recording.name

    @property
    def frame_count(self) -> int:
        """That of the recording."""
        return self.recording.frame_count

    @property
    def ground_truth(self) -> Trajectory | None:
        """That of the recording."""
        return self.recording.ground_truth

    @property
    def imu(self) -> ImuSamples | None:
        """That of the recording."""
        return imu_of(self.recording)

    def __iter__(self) -> Iterator[RgbdFrame]:
        for frame in self.recording:
            yield reduced(frame, self.max_width)

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        """Those frames, reduced."""
        for frame in self.recording.select(indices):
            yield reduced(frame, self.max_width)

    def close(self) -> None:
        """Releases the files."""
        self.recording.close()
