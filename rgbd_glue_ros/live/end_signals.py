"""Handling of SIGINT, SIGTERM and SIGHUP, however many arrive and however fast."""

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
    """Catches ``END_SIGNALS`` from its creation on, for a thread that waits for them.

    A handler that sets an event could deadlock: a second signal may interrupt it while it holds
    the event's lock, and then wait for that lock forever. Instead, the interpreter writes the
    signal's number to a pipe, whichever thread receives the signal.
    """

    def __init__(self) -> None:
        """Installs the handlers; must be called from the main thread."""
        self._read_end, self._write_end = os.pipe()
        os.set_blocking(self._write_end, False)  # a full pipe already holds enough requests
        signal.set_wakeup_fd(self._write_end, warn_on_full_buffer=False)
        _handle_by(_leave_to_the_pipe)

    def end(self) -> None:
        """Acts as if a signal had arrived; any thread may call it."""
        os.write(self._write_end, bytes([signal.SIGTERM]))

    def wait(self) -> None:
        """Returns as soon as a signal has arrived, also if that was before the call."""
        while not set(os.read(self._read_end, 1)) & set(END_SIGNALS):
            pass  # another signal's number


class InterruptOnce:
    """A handler that interrupts the main thread, but not its cleanup.

    Otherwise a second signal would interrupt the writing of results, or the shutdown of child
    processes. A signal that arrives ``SAME_REQUEST_S`` later is a new request. Computations
    postpone the interrupt (``uninterrupted``); waiting, loading and reading end immediately.
    """

    def __init__(self) -> None:
        """Installs the handler for ``END_SIGNALS``; must be called from the main thread."""
        self._last_s = -float("inf")
        _handle_by(self)

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        """Raises KeyboardInterrupt, unless an earlier signal has just done so."""
        last_s, self._last_s = self._last_s, time.monotonic()
        if self._last_s - last_s > SAME_REQUEST_S:
            raise KeyboardInterrupt


def end_at_once() -> None:
    """Lets a signal end the process with exit code 0: for a program that has nothing to finish yet.

    Must be called from the main thread.
    """
    _handle_by(_exit)


def _exit(_number: int, _frame: FrameType | None) -> None:
    # an exception would be printed, or caught, by whatever is being imported
    os._exit(0)


def _handle_by(handler: Callable[[int, FrameType | None], None]) -> None:
    """Installs a handler; when the interpreter ends, the signals are ignored.

    A process that ignores SIGHUP, as under nohup, continues to ignore it.
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
    """Prints unraisable exceptions, except for a signal that arrived as its handler changed."""
    if "ignored due to race condition" not in str(unraisable.exc_value):
        sys.__unraisablehook__(unraisable)


def _leave_to_the_pipe(_number: int, _frame: FrameType | None) -> None:
    pass
