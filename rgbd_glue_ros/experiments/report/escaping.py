"""Text of whatever origin in a page or a table: it is shown, and is never a part of it."""

from __future__ import annotations

import html
import re

from rgbd_glue_ros.printable import printable


def escape(text: str) -> str:
    """The text in HTML or SVG, between tags or in an attribute."""
    return html.escape(printable(text, kept="\n"))


def markdown(text: str) -> str:
    """The text in a line or a cell of Markdown: no tag, no link, no end of a cell."""
    return re.sub(r"([\\`|\[\]])", r"\\\1", printable(text).replace("<", "&lt;"))
