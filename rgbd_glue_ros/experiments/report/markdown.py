"""Tables and numbers in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rgbd_glue_ros.experiments.report.escaping import markdown

NOTHING = "–"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table with one line per row; its cells are text."""
    lines = [["---"] * len(head), *([markdown(cell) for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in [list(head), *lines])


def bullets(texts: Iterable[str]) -> str:
    """A list with one line per text."""
    return "\n".join(f"- {markdown(text)}" for text in texts)


def number(value: float | None, digits: int) -> str:
    """A number with a given number of decimals; a dash if there is none."""
    return NOTHING if value is None else f"{value:.{digits}f}"
