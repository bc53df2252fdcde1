"""Waiting for an optional transform only as long as it usually comes; does not depend on ROS."""

from __future__ import annotations

import time
from collections.abc import Callable

from rgbd_glue_ros.types import NANOSECONDS, Float64

MOST_MISSES = 3
"""Frames in a row that wait in vain; later ones do not wait."""

# A transform that comes later than this after its frame is of no use.
_LATE_NS = NANOSECONDS // 2
# A transform that always comes late costs one wait in this time.
_RETRY_S = 5.0

Lookup = Callable[[int, float], Float64 | None]
"""A transform [4, 4] at a stamp in nanoseconds, waited for so many seconds; None if it is late."""


class PatientLookup:
    """Looks up a transform at the stamps of frames, and waits for it while it usually comes.

    After ``MOST_MISSES`` it no longer waits, until the transform of a missed frame comes after all:
    its source lives, so one more frame waits.
    """

    def __init__(
        self, lookup: Lookup, wait_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Starts with patience.

        Args:
            lookup: looks up the transform.
            wait_s: how long a frame waits, seconds.
            clock: a monotonic clock, seconds.
        """
        self._lookup = lookup
        self._wait_s = wait_s
        self._clock = clock
        self._misses = 0
        self._missed_ns: int | None = None
        self._next_wait_s = -float("inf")

    @property
    def is_missing(self) -> bool:
        """Whether at least the last ``MOST_MISSES`` frames had no transform."""
        return self._misses >= MOST_MISSES

    def at(self, stamp_ns: int) -> Float64 | None:
        """The transform [4, 4] at a stamp, nanoseconds; None if there is none, or it is late."""
        found = self._lookup(stamp_ns, self._wait_s if self._is_expected() else 0.0)
        if found is not None:
            self._misses, self._missed_ns = 0, None
            return found
        self._misses += 1
        if self._missed_ns is None or not 0 <= stamp_ns - self._missed_ns < _LATE_NS:
            self._missed_ns = stamp_ns
        return None

    def _is_expected(self) -> bool:
        """Whether the next transform is worth waiting for."""
        if not self.is_missing:
            return True
        if self._clock() < self._next_wait_s or self._missed_ns is None:
            return False
        if self._lookup(self._missed_ns, 0.0) is None:
            return False
        self._next_wait_s = self._clock() + _RETRY_S
        return True
