"""Images of a recording that are in no frame."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from rgbd_glue_ros.types import NANOSECONDS

logger = logging.getLogger(__name__)

COLOR, DEPTH = "color", "depth"

# Below a tenth of all images, only the counts tell, as in the node.
_WORTH_A_WARNING = 0.1
# A longer pause is worth a warning: a tracked camera does not pause.
_LONG_GAP_NS = NANOSECONDS


@dataclass(frozen=True)
class LeftOut:
    """Counts of images.

    Attributes:
        images: all with a stamp of their own, by their kind, ``COLOR`` or ``DEPTH``.
        unpaired: those of them without a partner of their time, likewise; colour, depth and
            camera info make a frame.
        duplicates: of the kind that has most, those with a stamp that another one has.
    """

    images: Mapping[str, int] = field(default_factory=dict)
    unpaired: Mapping[str, int] = field(default_factory=dict)
    duplicates: int = 0


@runtime_checkable
class CountingRecording(Protocol):
    """A recording that counts what it leaves out."""

    @property
    def left_out(self) -> LeftOut:
        """Of the last iteration, so far."""


def left_out_of(recording: object) -> LeftOut:
    """What a recording leaves out; nothing where it does not count."""
    return recording.left_out if isinstance(recording, CountingRecording) else LeftOut()


class FrameGaps:
    """The longest time without a frame.

    Attributes:
        longest_ns: time between two frames, at most; 0 below two.
        from_ns: stamp of the first of the two.
    """

    def __init__(self) -> None:
        self.longest_ns = self.from_ns = 0
        self._last_ns: int | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there was no frame."""
        return self._last_ns is None

    def add(self, stamp_ns: int) -> None:
        """Takes the stamp of the next frame; one that goes back ends no gap."""
        if self._last_ns is not None and stamp_ns - self._last_ns > self.longest_ns:
            self.longest_ns, self.from_ns = stamp_ns - self._last_ns, self._last_ns
        self._last_ns = stamp_ns


def warn_of_left_out(
    name: object, left_out: LeftOut, gaps: FrameGaps, without_stamps: str = ""
) -> None:
    """Logs what a recording left out, if that is a tenth of its images or there is a long gap.

    Args:
        name: of the recording.
        left_out: of it.
        gaps: between its frames.
        without_stamps: what to do if stamps do not tell its images apart.
    """
    if left_out.duplicates:
        are_most = left_out.duplicates > max(left_out.images.values(), default=0)
        logger.warning(
            "%s: images that repeat a stamp and were left out: %d%s",
            *(name, left_out.duplicates),
            f"; {without_stamps}" if without_stamps and are_most else "",
        )
    is_long = gaps.longest_ns > _LONG_GAP_NS
    said = [
        f"{count} of {left_out.images[kind]} {kind} images"
        for kind, count in left_out.unpaired.items()
        if count and (is_long or count >= _WORTH_A_WARNING * left_out.images[kind])
    ]
    if said:
        logger.warning(
            "%s: %s have no partner near their stamp (colour, depth and camera info make a frame) "
            "and were left out; the longest time without a frame is %.2f s, from %.3f s on",
            *(name, " and ".join(said), gaps.longest_ns / NANOSECONDS, gaps.from_ns / NANOSECONDS),
        )
