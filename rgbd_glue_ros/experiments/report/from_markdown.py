"""Converts the Markdown that this package writes to HTML: one text for repository and browser."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator

from rgbd_glue_ros.experiments.report.escaping import escape

_CELL_ENDS = re.compile(r"(?<!\\)\|")
# The first letter of Unicode's private use.
_ASIDE = 0xE000
_INLINE = (
    (re.compile(r"\*\*(.+?)\*\*"), r"<b>\1</b>"),
    (re.compile(r"`(.+?)`"), r"<code>\1</code>"),
    # its links are to files beside it in the repository
    (re.compile(r"(?<!!)\[(.+?)\]\(.+?\)"), r"\1"),
)


def from_markdown(text: str, images: dict[str, str]) -> list[str]:
    """Headings, paragraphs, tables, lists, code and pictures, in their order.

    Args:
        text: as written by ``report/markdown.py`` and its users; its first heading is omitted,
            since it is the page's.
        images: HTML of the pictures, by the file that the text names.
    """
    blocks = [block for block in re.split(r"\n{2,}", text.strip()) if block]
    if blocks and blocks[0].startswith("# "):
        blocks.pop(0)
    return [_block(block, images) for block in blocks]


def _block(block: str, images: dict[str, str]) -> str:
    lines = block.splitlines()
    heading = re.match(r"(#{2,3}) (.*)", block)
    picture = re.fullmatch(r"!\[.*\]\((.+)\)", block)
    if heading:
        level = len(heading[1])
        return f"<h{level}>{_inline(heading[2])}</h{level}>"
    if picture:
        return f"<figure>{images.get(picture[1], '')}</figure>"
    if lines[0].startswith("```"):
        return f"<p><code>{escape(' '.join(lines[1:-1]))}</code></p>"
    if lines[0].startswith("|"):
        return _table(lines)
    if lines[0].startswith("- "):
        entries = "".join(f"<li>{_inline(line.removeprefix('- '))}</li>" for line in lines)
        return f"<ul>{entries}</ul>"
    return f"<p>{_inline(' '.join(lines))}</p>"


def _table(lines: list[str]) -> str:
    head, _, *rows = (list(_cells(line)) for line in lines)
    body = "".join(f"<tr>{_row(row, 'td')}</tr>" for row in rows)
    return f'<div class="wide"><table><tr>{_row(head, "th")}</tr>{body}</table></div>'


def _cells(line: str) -> Iterator[str]:
    return (_inline(cell.strip()) for cell in _CELL_ENDS.split(line)[1:-1])


def _row(cells: list[str], tag: str) -> str:
    # numbers are aligned at the right
    return "".join(
        f'<{tag} class="n">{cell}</{tag}>' if i else f"<{tag}>{cell}</{tag}>"
        for i, cell in enumerate(cells)
    )


def _inline(text: str) -> str:
    # letters that only look like markup are replaced by others, which no text contains
    shown = escape(html.unescape(text))
    shown = re.sub(r"\\([\\`|\[\]])", lambda m: chr(_ASIDE + ord(m[1])), shown)
    for pattern, replacement in _INLINE:
        shown = pattern.sub(replacement, shown)
    return "".join(chr(ord(c) - _ASIDE) if _ASIDE <= ord(c) < _ASIDE + 128 else c for c in shown)
