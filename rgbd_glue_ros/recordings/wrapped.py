"""A recording derived from another one."""

from __future__ import annotations

from dataclasses import dataclass

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.recordings.left_out import LeftOut, left_out_of
from rgbd_glue_ros.recordings.recording import Recording, imu_of
from rgbd_glue_ros.types import ImuSamples, Trajectory


@dataclass(frozen=True)
class WrappedRecording(Closing):
    """The common properties of a recording and of one derived from it.

    Attributes:
        recording: the underlying recording.
    """

    recording: Recording

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
    def left_out(self) -> LeftOut:
        """That of the recording."""
        return left_out_of(self.recording)

    def close(self) -> None:
        """Closes the recording."""
        self.recording.close()


@dataclass(frozen=True)
class WrappedInertialRecording(WrappedRecording):
    """One whose frames are at the times of the recording's, so that its IMU fits them."""

    @property
    def imu(self) -> ImuSamples | None:
        """All samples of the recording."""
        return imu_of(self.recording)


def unwrapped(recording: Recording) -> Recording:
    """The recording that a derived one comes from, whatever its frames went through since."""
    while isinstance(recording, WrappedRecording):
        recording = recording.recording
    return recording
