"""How many messages of a topic have arrived, and when the last did."""

from __future__ import annotations

import time
from collections.abc import Callable

from rgbd_glue_ros.types import NANOSECONDS


class Arrivals:
    """Counts the messages of a topic.

    Attributes:
        count: how many have arrived so far.
    """

    def __init__(self, clock: Callable[[], int] = time.monotonic_ns) -> None:
        """Starts to count.

        Args:
            clock: a monotonic clock, nanoseconds.
        """
        self.count = 0
        self._clock = clock
        self._last_ns = 0

    def add(self) -> None:
        """Counts a message that arrives now."""
        self.count += 1
        self._last_ns = self._clock()

    def __str__(self) -> str:
        """As ``the last of 573 messages came 5 s ago``; empty before the first."""
        if not self.count:
            return ""
        ago = f"came {(self._clock() - self._last_ns) / NANOSECONDS:.0f} s ago"
        return (
            f"the only message {ago}"
            if self.count == 1
            else f"the last of {self.count} messages {ago}"
        )
