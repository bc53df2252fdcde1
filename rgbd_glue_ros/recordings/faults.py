"""Unusable parts of a recording: skipped, counted, and each kind logged once."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fault_news import FaultNews
from rgbd_glue_ros.recordings.left_out import FrameGaps
from rgbd_glue_ros.types import RgbdFrame

logger = logging.getLogger(__name__)


class Faults:
    """Counts faults, and logs new kinds once it is known that they are only skipped.

    A recording in which nothing is usable ends with its first fault as an error, which is not to be
    logged before.

    Attributes:
        count: number of faults.
        first: the first one; None without any.
    """

    def __init__(self) -> None:
        self.count = 0
        self.first: InputError | None = None
        self._news = FaultNews()
        self._are_skipped = False
        self._unlogged: list[InputError] = []

    def add(self, error: InputError) -> None:
        """Counts a fault, and logs it unless one of its kind was logged."""
        self.count += 1
        self.first = self.first or error
        if self._news.is_news(error.where, error.cause):
            self._unlogged.append(error)
        self._log()

    def are_skipped(self) -> None:
        """Logs the faults so far, and those to come: the recording is used without them."""
        self._are_skipped = True
        self._log()

    def without(
        self, frames: Iterable[RgbdFrame | InputError], gaps: FrameGaps
    ) -> Iterator[RgbdFrame]:
        """The frames that could be read; the faults of the others are counted here.

        Args:
            frames: what was read, or why it could not be.
            gaps: takes the stamps of those that could.
        """
        for frame in frames:
            if isinstance(frame, InputError):
                self.add(frame)
            else:
                self.are_skipped()
                gaps.add(frame.stamp_ns)
                yield frame

    def _log(self) -> None:
        if self._are_skipped:
            for error in self._unlogged:
                logger.warning("%s; skipped, as all like it will be", error)
            self._unlogged.clear()


def readable(
    name: str, frames: Iterable[RgbdFrame | InputError], count: int, gaps: FrameGaps
) -> Iterator[RgbdFrame]:
    """The frames that could be read; the others are skipped, counted and logged.

    Args:
        name: of the recording.
        frames: what was read, or why it could not be.
        count: the number of ``frames``.
        gaps: takes the stamps of those that could be read.

    Raises:
        InputError: at the end, the first fault, if no frame could be read.
    """
    faults = Faults()
    yield from faults.without(frames, gaps)
    if faults.first is not None:
        if gaps.is_empty:
            raise faults.first
        logger.warning("%s: %d frames skipped of %d", name, faults.count, count)
