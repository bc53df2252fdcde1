"""A line of the terminal that is written again and again; without a terminal, a line a second."""

from __future__ import annotations

import shutil
from typing import TextIO

from rgbd_glue_ros.errors import without_numbers
from rgbd_glue_ros.printable import printable

# Often enough for the eye, and for a file.
_TERMINAL_S, _FILE_S = 0.1, 1.0


class StatusLine:
    """Shows a state that changes.

    Attributes:
        period_s: how often it is worth to show it.
        fault: why nothing can be shown any more, as when the reader of a pipe has gone; None if it
            can.
    """

    def __init__(self, stream: TextIO) -> None:
        """Writes nothing yet.

        Args:
            stream: where to write.
        """
        self.fault: OSError | None = None
        self._stream = stream
        self._is_terminal = stream.isatty()
        self.period_s = _TERMINAL_S if self._is_terminal else _FILE_S
        self._last_reason = ""
        self._width = 0

    def show(self, line: str, reason: str) -> None:
        """Shows the state.

        A reason that differs from the one before, in more than numbers, gets a line of its own on a
        terminal, since it may be longer than the terminal is wide. A file has it there alone.

        Args:
            line: the state.
            reason: what is wrong; "" if nothing is.

        Raises:
            OSError: it cannot be written.
        """
        text = f"{line}: {reason}" if reason else line
        before, self._last_reason = self._last_reason, without_numbers(reason)
        is_news = self._last_reason not in ("", before)
        if is_news or not self._is_terminal:
            self.say(text if is_news else line)
        if not self._is_terminal:
            return
        # a character in the last column would begin another line
        shown = printable(text)[: shutil.get_terminal_size().columns - 1]
        self._write(f"\r{shown.ljust(self._width)}\r{shown}")
        self._width = len(shown)

    def say(self, line: str) -> None:
        """Shows a line that stays, above the state.

        Raises:
            OSError: it cannot be written.
        """
        self._clear()
        self._write(f"{printable(line)}\n")

    def _clear(self) -> None:
        if self._width:
            self._write(f"\r{' ' * self._width}\r")
            self._width = 0

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except OSError as error:
            self.fault = error
            raise
