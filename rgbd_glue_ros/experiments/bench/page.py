"""``bench.html``: the tables and the picture of a benchmark for a browser."""

from __future__ import annotations

from rgbd_glue_ros.experiments.bench.picture import PICTURE
from rgbd_glue_ros.experiments.report.from_markdown import from_markdown
from rgbd_glue_ros.experiments.report.page import page

_CSS = """
.wide .n { padding-left: .9rem; } h3 { font-size: .95rem; margin: 1.6rem 0 .6rem; }
figure svg { display: block; width: 100%; min-width: 640px; max-width: 840px; height: auto;
  border-radius: 8px; }
figure { margin: 1.5rem 0; overflow-x: auto; } li { color: var(--quiet); margin-bottom: .3rem; }
"""


def render(tables: str, drawn: str | None) -> str:
    """The page.

    Args:
        tables: ``bench.md``.
        drawn: ``bench.svg``; None where there is none.
    """
    return page("Benchmarks", from_markdown(tables, {PICTURE: drawn or ""}), _CSS)
