"""Escapes text of any origin for a page or a table."""

from __future__ import annotations

import html
import re

from rgbd_glue_ros.printable import printable


def escape(text: str) -> str:
    """The text for HTML or SVG, between tags or in an attribute."""
    return html.escape(printable(text, kept="\n"))


def markdown(text: str) -> str:
    """The text for a line or a cell of Markdown, without tags, links and ends of cells."""
    return re.sub(r"([\\`|\[\]])", r"\\\1", printable(text).replace("<", "&lt;"))
