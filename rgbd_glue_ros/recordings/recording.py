"""What a recorded sequence is: frames in order of time, and the truth about them if known."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Protocol, runtime_checkable

from rgbd_glue_ros.types import ImuSamples, RgbdFrame, Trajectory


class Recording(Protocol):
    """A recording; it can be iterated more than once, and gives the same frames each time."""

    @property
    def name(self) -> str:
        """What to call it in a report."""

    @property
    def frame_count(self) -> int:
        """How many frames it holds, at most."""

    @property
    def ground_truth(self) -> Trajectory | None:
        """True poses T_world_camera (optical frame), None if not known."""

    def __iter__(self) -> Iterator[RgbdFrame]:
        """The frames in order of time; single ones that cannot be read are skipped and said.

        Raises:
            InputError: none can be read, or from some place on none; those before it were given.
        """

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        """The frames of these numbers, counted from 0 in order of time.

        Args:
            indices: increasing; those beyond the last frame are left out.

        Raises:
            InputError: a frame cannot be read; those before it were given.
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
    """A recording that may hold the samples of an IMU too."""

    @property
    def imu(self) -> ImuSamples | None:
        """In the axes of the camera's optical frame; None if there are none, or none of use."""


def imu_of(recording: Recording) -> ImuSamples | None:
    """The samples of a recording's IMU; None if it holds none."""
    return recording.imu if isinstance(recording, InertialRecording) else None


def selected(frames: Iterable[RgbdFrame], indices: Iterable[int]) -> Iterator[RgbdFrame]:
    """The frames of increasing numbers out of those that can only be had one after the other."""
    numbered = enumerate(frames)
    for wanted in indices:
        for number, frame in numbered:
            if number == wanted:
                yield frame
                break
