"""Which faults deserve a line in the log: each kind once, and not hundreds in a minute."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable

from rgbd_glue_ros.errors import without_numbers
from rgbd_glue_ros.types import NANOSECONDS

# A camera gone mad must not fill the memory or the log, nor keep what comes later out of it.
MAX_FAULTS = 100
"""Faults that are remembered, and that are told in ``FAULTS_WINDOW_NS``, at most."""

FAULTS_WINDOW_NS = 600 * NANOSECONDS


class FaultNews:
    """Remembers the faults told lately. Any thread may call it.

    Attributes:
        last: the last fault, news or not; "" before the first.
    """

    def __init__(self, clock: Callable[[], int] = time.monotonic_ns) -> None:
        """Remembers none.

        Args:
            clock: the time in nanoseconds, which never goes back.
        """
        self.last = ""
        self._clock = clock
        self._lock = threading.Lock()
        self._faults: OrderedDict[tuple[str, str], None] = OrderedDict()
        self._told_ns: deque[int] = deque(maxlen=MAX_FAULTS)

    def is_news(self, where: str, cause: str) -> bool:
        """Whether a fault was not seen before, as far as is remembered, and deserves a line.

        Faults that differ in numbers alone are the same.
        """
        kind = without_numbers(where), without_numbers(cause)
        now_ns = self._clock()
        with self._lock:
            self.last = f"{where}: {cause}"
            if kind in self._faults:
                self._faults.move_to_end(kind)
                return False
            is_flood = len(self._told_ns) == MAX_FAULTS and (
                now_ns - self._told_ns[0] < FAULTS_WINDOW_NS
            )
            if is_flood:
                return False
            self._told_ns.append(now_ns)
            self._faults[kind] = None
            if len(self._faults) > MAX_FAULTS:
                self._faults.popitem(last=False)
            return True

    def forget(self) -> None:
        """Takes what comes again for news, as where all was well in between."""
        with self._lock:
            self._faults.clear()
