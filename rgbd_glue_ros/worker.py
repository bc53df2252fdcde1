"""One thread that works on the newest item: a slow consumer of a live stream never falls behind."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")
logger = logging.getLogger(__name__)


class NewestWorker(Generic[T]):
    """Hands items to a function on its own thread, one at a time, the newest first.

    There is one slot: an item that arrives while another waits in it takes its place, and the
    older one is dropped. An exception of the function is logged and the thread goes on.
    """

    def __init__(self, work: Callable[[T], None], dropped: Callable[[T], None]) -> None:
        """Starts the thread.

        Args:
            work: called with each item, on the thread.
            dropped: called with an item that a newer one replaced, where that was submitted.
        """
        self._work = work
        self._dropped = dropped
        self._slot: list[T] = []
        self._changed = threading.Condition()
        self._closed = False
        # a daemon, so that work that never ends cannot keep the process alive
        self._thread = threading.Thread(target=self._run, name="newest-worker", daemon=True)
        self._thread.start()

    def submit(self, item: T) -> None:
        """Leaves ``item`` for the thread; returns at once."""
        with self._changed:
            replaced = list(self._slot)
            self._slot[:] = [item]
            self._changed.notify()
        for older in replaced:
            self._dropped(older)

    def close(self, timeout_s: float) -> bool:
        """Lets the item in work be finished, drops one that waits, and ends the thread.

        Args:
            timeout_s: how long to wait for the item in work, seconds.

        Returns:
            Whether the thread has ended.
        """
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._slot)
                if self._closed:
                    return
                item = self._slot.pop()
            try:
                self._work(item)
            except Exception:
                logger.exception("A frame could not be processed; going on with the next")
