"""The output files of an experiment."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rgbd_glue_ros.experiments.pairs.gallery import Example
from rgbd_glue_ros.experiments.pairs.page import render
from rgbd_glue_ros.experiments.pairs.results import PairResults
from rgbd_glue_ros.experiments.pairs.tables import to_markdown
from rgbd_glue_ros.files.writing import json_text, write_whole
from rgbd_glue_ros.parameters import Config

JOURNAL, FIGURES, TABLES, REPORT = "pairs.jsonl", "pairs.json", "pairs.md", "report.html"


def write_report(
    folder: Path,
    config: Config,
    results: PairResults,
    figures: dict[str, Any],
    shown: Sequence[Example] = (),
) -> None:
    """Writes the figures, tables of them, and a page with pictures of some pairs.

    Args:
        folder: where the files go.
        config: of the experiment.
        results: of every pair; at least one.
        figures: of these, as ``PairResults.figures`` gives them.
        shown: pairs to show pictures of, the worst first.
    """
    write_whole(folder / FIGURES, json_text(figures))
    write_whole(folder / TABLES, to_markdown(figures))
    write_whole(folder / REPORT, render(figures, results.by_method, config, shown))
