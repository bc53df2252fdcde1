"""Ending in order: what holds something open is closed, and computations are not interrupted."""

from __future__ import annotations

import signal
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, ClassVar, TypeVar

C = TypeVar("C", bound="Closing")

END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, a kill, and the end of the terminal."""

SAME_REQUEST_S = 1.0
"""Signals within this time are one request: a launch system and a shell may both send one."""


class Closing(ABC):
    """A context manager that closes itself."""

    @abstractmethod
    def close(self) -> None:
        """Releases all resources."""

    def __enter__(self: C) -> C:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Defers the handling of ``END_SIGNALS`` to the end of the ``with``; also a decorator.

    A handler raises KeyboardInterrupt wherever the main thread happens to be. Inside compiled code
    or a library's C++ that ends in a SystemError or a crash, and inside the processing of a frame
    it leaves half of its results. So this goes around computations; not around waiting, which is
    to end at once.

    A signal that comes more than ``SAME_REQUEST_S`` after the one before it is handled at once,
    since the computation may be stuck. So is one that comes while a KeyboardInterrupt is being
    handled. In the end the handlers are what they were. May be nested; does nothing in other
    threads, which no signal interrupts.
    """
    is_interrupted = isinstance(sys.exc_info()[1], KeyboardInterrupt)
    if is_interrupted or _DeferredSignals.current is not None or not _is_main_thread():
        yield
        return
    deferred = _DeferredSignals()
    try:
        deferred.begin()
        yield
    finally:
        deferred.end()


def check_signals() -> None:
    """Handles a deferred signal now: for places where a long computation can be left."""
    deferred = _DeferredSignals.current
    if deferred is not None and _is_main_thread():
        deferred.handle()


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


class _DeferredSignals:
    """Replaces the handlers of ``END_SIGNALS`` for a while, and calls them later.

    A handler may raise between any two steps of ``begin`` and ``end``. If that keeps ``end`` from
    restoring another handler, its replacement passes signals on to it.
    """

    current: ClassVar[_DeferredSignals | None] = None

    def __init__(self) -> None:
        self._handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
        self._pending: int | None = None
        self._last_s = -float("inf")
        self._has_ended = False

    def begin(self) -> None:
        """Replaces the handlers that are Python functions; others interrupt nothing."""
        for number in END_SIGNALS:
            handler = signal.getsignal(number)
            if callable(handler):
                self._handlers[number] = handler
                signal.signal(number, self)
        _DeferredSignals.current = self

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Keeps the first signal, and those of the same request, for later."""
        last_s, self._last_s = self._last_s, time.monotonic()
        is_same_request = self._pending is None or self._last_s - last_s <= SAME_REQUEST_S
        if is_same_request and not self._has_ended:
            self._pending = number
            return
        self._pending = None
        self._handlers[number](number, frame)

    def end(self) -> None:
        """Restores the handlers, and handles what came meanwhile."""
        self._has_ended, _DeferredSignals.current = True, None
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self.handle()

    def handle(self) -> None:
        """Calls the handler of a signal that was deferred, if there is one."""
        pending, self._pending = self._pending, None
        if pending is not None:
            self._handlers[pending](pending, None)
