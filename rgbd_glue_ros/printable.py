"""Makes text of any origin printable: terminal control sequences are escaped."""

from __future__ import annotations

import logging
from types import TracebackType

ExceptionInfo = (
    tuple[type[BaseException], BaseException, TracebackType | None] | tuple[None, None, None]
)


def printable(text: str, kept: str = "") -> str:
    r"""The text with every character that is not printable as its escape, such as ``\x1b``.

    Names of files, frames and topics may contain sequences that clear a screen, set a title or
    reverse a line, and bytes that are not text.

    Args:
        text: any text.
        kept: characters that stay as they are.
    """
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() or c in kept else c.encode("unicode_escape").decode("ascii")
        for c in text
    )


def counted(count: int, noun: str, several: str = "") -> str:
    """As ``1 frame``, ``2 frames``, and with a plural ``1 line holds``, ``2 lines hold``."""
    return f"{count} {noun}" if count == 1 else f"{count} {several or f'{noun}s'}"


class PrintableFormatter(logging.Formatter):
    """Formats a log message as one printable line; a traceback follows on its own lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: D102 - see the base class
        return printable(super().formatMessage(record))

    def formatException(self, ei: ExceptionInfo) -> str:  # noqa: D102 - see the base class
        return printable(super().formatException(ei), kept="\n")
