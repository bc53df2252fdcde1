"""SIGINT, SIGTERM and SIGHUP, however many come and however fast."""

from __future__ import annotations

import atexit
import os
import signal
import sys
import time
from collections.abc import Callable
from types import FrameType

from rgbd_glue_ros.closing import END_SIGNALS, SAME_REQUEST_S


class EndSignals:
    """Keeps ``END_SIGNALS``, from its creation on, for the thread that waits for them.

    A handler that sets an event would not do: a second signal interrupts it while it holds the
    event's lock, and waits for that lock for ever. Here the interpreter writes the signal's number
    to a pipe, whichever thread receives the signal.
    """

    def __init__(self) -> None:
        """Takes the signals over. To be called from the main thread."""
        self._read_end, self._write_end = os.pipe()
        os.set_blocking(self._write_end, False)  # a full pipe is request enough
        signal.set_wakeup_fd(self._write_end, warn_on_full_buffer=False)
        _handle_by(_leave_to_the_pipe)

    def end(self) -> None:
        """Does as if a signal had come; any thread may call it."""
        os.write(self._write_end, bytes([signal.SIGTERM]))

    def wait(self) -> None:
        """Returns as soon as a signal has come, be it before the call."""
        while not set(os.read(self._read_end, 1)) & set(END_SIGNALS):
            pass  # another signal's number


class InterruptOnce:
    """A handler that interrupts the main thread, but not what that does in order to end.

    Else a second signal would interrupt the writing of the results, or the end of the processes
    that were started. A signal that comes ``SAME_REQUEST_S`` later is a new request. Computations
    defer it (``uninterrupted``); waiting, loading and reading end at once.
    """

    def __init__(self) -> None:
        """Takes ``END_SIGNALS`` over. To be called from the main thread."""
        self._last_s = -float("inf")
        _handle_by(self)

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        """Raises KeyboardInterrupt, unless an earlier signal has just done so."""
        last_s, self._last_s = self._last_s, time.monotonic()
        if self._last_s - last_s > SAME_REQUEST_S:
            raise KeyboardInterrupt


def _handle_by(handler: Callable[[int, FrameType | None], None]) -> None:
    """Gives the signals a handler, until the interpreter ends: then they change nothing more.

    A process that is to outlive its terminal goes on ignoring its end, as under nohup.
    """
    atexit.register(_ignore)
    for number in END_SIGNALS:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


def _ignore() -> None:
    sys.unraisablehook = _without_lost_signals
    for number in END_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def _without_lost_signals(unraisable: sys.UnraisableHookArgs) -> None:
    """Prints what the interpreter can't raise, but not that a signal met an exchanged handler."""
    if "ignored due to race condition" not in str(unraisable.exc_value):
        sys.__unraisablehook__(unraisable)


def _leave_to_the_pipe(_number: int, _frame: FrameType | None) -> None:
    pass
