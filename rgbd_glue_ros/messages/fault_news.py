"""Which faults to log: each kind once, and not hundreds per minute."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable

from rgbd_glue_ros.errors import without_numbers
from rgbd_glue_ros.types import NANOSECONDS

# A faulty camera must not fill the memory or the log, nor suppress later faults.
MAX_FAULTS = 100
"""Maximum number of remembered faults, and of faults reported within ``FAULTS_WINDOW_NS``."""

FAULTS_WINDOW_NS = 600 * NANOSECONDS


class FaultNews:
    """Remembers recently reported faults; thread-safe.

    Attributes:
        last: the last fault, new or not; "" before the first.
    """

    def __init__(self, clock: Callable[[], int] = time.monotonic_ns) -> None:
        """Starts without faults.

        Args:
            clock: a monotonic clock, nanoseconds.
        """
        self.last = ""
        self._clock = clock
        self._lock = threading.Lock()
        self._faults: OrderedDict[tuple[str, str], None] = OrderedDict()
        self._told_ns: deque[int] = deque(maxlen=MAX_FAULTS)

    def is_news(self, where: str, cause: str) -> bool:
        """Whether a fault is new and should be logged.

        Faults that differ only in numbers count as the same.
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
        """Forgets all faults, so that they are new again, as after a time without faults."""
        with self._lock:
            self._faults.clear()
