"""A recording with ground truth from elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from rgbd_glue_ros.recordings.recording import Recording
from rgbd_glue_ros.recordings.wrapped import WrappedInertialRecording
from rgbd_glue_ros.types import RgbdFrame, Trajectory


def with_ground_truth(recording: Recording, truth: Trajectory | None) -> Recording:
    """The recording with true poses T_world_camera other than its own; itself if they are None."""
    return recording if truth is None else _OtherTruth(recording, truth)


@dataclass(frozen=True)
class _OtherTruth(WrappedInertialRecording):
    """A ``Recording`` whose ground truth is ``truth``."""

    truth: Trajectory

    @property
    def ground_truth(self) -> Trajectory:
        """The given one."""
        return self.truth

    def __iter__(self) -> Iterator[RgbdFrame]:
        return iter(self.recording)

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        """The frames with these numbers."""
        return self.recording.select(indices)
