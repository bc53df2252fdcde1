"""Text of whatever origin, made fit to be seen: what steers a terminal is written out."""

from __future__ import annotations


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
