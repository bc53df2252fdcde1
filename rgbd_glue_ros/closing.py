"""What ends in order: files and threads are closed, and a computation is not cut in two."""

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

SAME_WISH_S = 1.0
"""Signals so soon after one another are one wish: a launch system and a shell may both tell."""


class Closing(ABC):
    """A context manager that closes itself."""

    @abstractmethod
    def close(self) -> None:
        """Releases what is held."""

    def __enter__(self: C) -> C:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Puts off what Python does about ``END_SIGNALS`` to the end of the ``with``.

    A KeyboardInterrupt is raised wherever the main thread is. In the middle of compiled code or of
    a library's C++ it ends in a SystemError or a crash, and in the middle of a frame it leaves half
    of it. To be put around computations, and not around what waits: that is to end at once. A
    signal that comes more than ``SAME_WISH_S`` after the one before interrupts at once, as what is
    computed may be stuck; so does one that comes while a KeyboardInterrupt is dealt with.

    Handlers are as before in the end. Other threads are never interrupted, and nothing is done
    there. May be nested, and be used as a decorator.
    """
    is_told = isinstance(sys.exc_info()[1], KeyboardInterrupt)
    if is_told or _PutOff.current is not None or not _is_main_thread():
        yield
        return
    put_off = _PutOff()
    try:
        put_off.begin()
        yield
    finally:
        put_off.end()


def interrupt_if_told() -> None:
    """Does now what ``uninterrupted`` puts off, if there is anything: where it takes too long."""
    put_off = _PutOff.current
    if put_off is not None and _is_main_thread():
        put_off.deliver()


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


class _PutOff:
    """Stands in for the handlers of ``END_SIGNALS``, and calls them later.

    A handler may raise between any two steps here. Where it keeps ``end`` from giving another one
    its place back, the stand-in that is left does what that one does.
    """

    current: ClassVar[_PutOff | None] = None

    def __init__(self) -> None:
        self._handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
        self._noted: int | None = None
        self._last_s = -float("inf")
        self._is_over = False

    def begin(self) -> None:
        """Takes the places of handlers in Python; others end the process, or do nothing."""
        for number in END_SIGNALS:
            handler = signal.getsignal(number)
            if callable(handler):
                self._handlers[number] = handler
                signal.signal(number, self)
        _PutOff.current = self

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Notes the first signal, and those soon after one another."""
        last_s, self._last_s = self._last_s, time.monotonic()
        is_same_wish = self._noted is None or self._last_s - last_s <= SAME_WISH_S
        if is_same_wish and not self._is_over:
            self._noted = number
            return
        self._noted = None
        self._handlers[number](number, frame)

    def end(self) -> None:
        """Gives the handlers their places back, and lets one do what was put off."""
        self._is_over, _PutOff.current = True, None
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self.deliver()

    def deliver(self) -> None:
        """Has the handler do what was put off, if there is anything."""
        noted, self._noted = self._noted, None
        if noted is not None:
            self._handlers[noted](noted, None)
