"""Text of whatever origin, made fit to be seen: what steers a terminal is written out."""

from __future__ import annotations

import logging
from types import TracebackType

ExceptionInfo = (
    tuple[type[BaseException], BaseException, TracebackType | None] | tuple[None, None, None]
)


def printable(text: str, kept: str = "") -> str:
    r"""The text with every character that is not printable as its escape, such as ``\x1b``.

    Names of files, frames and topics may hold what clears a screen, sets a title or turns the
    direction of a line, and bytes that are no text.

    Args:
        text: of any characters.
        kept: characters that stay as they are.
    """
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() or c in kept else c.encode("unicode_escape").decode("ascii")
        for c in text
    )


class PrintableFormatter(logging.Formatter):
    """A message of a log is one line that is printable; a traceback has lines of its own below."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: D102 - see the base class
        return printable(super().formatMessage(record))

    def formatException(self, ei: ExceptionInfo) -> str:  # noqa: D102 - see the base class
        return printable(super().formatException(ei), kept="\n")
