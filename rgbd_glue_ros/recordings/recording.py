"""The interface of recorded sequences: frames in order of time, and ground truth if known."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Protocol, runtime_checkable

from rgbd_glue_ros.types import ImuSamples, RgbdFrame, Trajectory


class Recording(Protocol):
    """A recording; it can be iterated more than once, and gives the same frames each time."""

    @property
    def name(self) -> str:
        """Its name in a report."""

    @property
    def frame_count(self) -> int:
        """The maximum number of frames."""

    @property
    def ground_truth(self) -> Trajectory | None:
        """True poses T_world_camera (optical frame), None if not known."""

    def __iter__(self) -> Iterator[RgbdFrame]:
        """The frames in order of time; single unreadable ones are skipped and logged.

        Raises:
            InputError: no frame can be read, or none from some point on; earlier ones were
                returned.
        """

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        """The frames with these numbers, counted from 0 in order of time.

        Args:
            indices: increasing; those beyond the last frame are ignored.

        Raises:
            InputError: a frame cannot be read; those before it were returned.
        """

    def close(self) -> None:
        """Releases the files."""

    def __enter__(self) -> Recording: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


@runtime_checkable
class InertialRecording(Protocol):
    """A recording that may also contain samples of an IMU."""

    @property
    def imu(self) -> ImuSamples | None:
        """The samples in the axes of the camera's optical frame; None if none are usable."""


def imu_of(recording: Recording) -> ImuSamples | None:
    """The samples of a recording's IMU; None if there are none."""
    return recording.imu if isinstance(recording, InertialRecording) else None


def selected(frames: Iterable[RgbdFrame], indices: Iterable[int]) -> Iterator[RgbdFrame]:
    """The frames with increasing numbers from frames that can only be read in sequence."""
    numbered = enumerate(frames)
    for wanted in indices:
        for number, frame in numbered:
            if number == wanted:
                yield frame
                break
