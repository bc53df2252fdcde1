"""A thread that processes items of a live stream, with two kinds of queue."""

from __future__ import annotations

import logging
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")
logger = logging.getLogger(__name__)


class Worker(ABC, Generic[T]):
    """Calls a function with items on its own thread, one at a time, in order of submission.

    An exception of the function is logged, and the thread continues.
    """

    def __init__(self, work: Callable[[T], None]) -> None:
        """Starts the thread.

        Args:
            work: called with each item, on the thread.
        """
        self._work = work
        self._waiting: deque[T] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self._is_idle = True
        # a daemon, so that endless work cannot keep the process alive
        self._thread = threading.Thread(target=self._run, name="worker", daemon=True)
        self._thread.start()

    def __len__(self) -> int:
        """Number of items that wait; the current one does not count."""
        return len(self._waiting)

    @abstractmethod
    def submit(self, item: T) -> None:
        """Submits ``item`` to the thread."""

    def close(self, timeout_s: float) -> bool:
        """Waits for the current item, drops the queued ones, and ends the thread.

        Args:
            timeout_s: how long to wait for the current item, seconds.

        Returns:
            Whether the thread has ended.
        """
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._is_idle = True
                self._changed.wait_for(lambda: self._closed or self._waiting)
                if self._closed:
                    return
                item = self._waiting.popleft()
                self._is_idle = False
                self._changed.notify_all()
            try:
                self._work(item)
            except Exception:
                logger.exception("A frame could not be processed; continuing with the next")


class NewestWorker(Worker[T]):
    """Keeps only the newest waiting item, so that a slow consumer never falls behind."""

    def __init__(self, work: Callable[[T], None], dropped: Callable[[T], None]) -> None:
        """Starts the thread.

        Args:
            work: called with each item, on the thread.
            dropped: called with an item that a newer one replaced, on the submitting thread.
        """
        self._dropped = dropped
        super().__init__(work)

    def submit(self, item: T) -> None:
        """Submits ``item`` to the thread; returns immediately."""
        with self._changed:
            # an item that the idle thread is about to take is not replaced
            taken = [self._waiting.popleft()] if self._is_idle and self._waiting else []
            replaced = list(self._waiting)
            self._waiting = deque([*taken, item])
            self._changed.notify_all()
        for older in replaced:
            self._dropped(older)


class QueueWorker(Worker[T]):
    """Drops no item: ``submit`` blocks while the queue is full."""

    def __init__(self, work: Callable[[T], None], size: int) -> None:
        """Starts the thread.

        Args:
            work: called with each item, on the thread.
            size: queued items, at most.
        """
        self._size = size
        super().__init__(work)

    def submit(self, item: T) -> None:
        """Submits ``item``; returns when there is room for it, or after ``close``."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or len(self._waiting) < self._size)
            self._waiting.append(item)
            self._changed.notify_all()
