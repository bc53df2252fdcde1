"""What the documentation repeats of the code is what the code says."""

from __future__ import annotations

from pathlib import Path

from rgbd_glue_ros.config import NodeConfig, to_markdown

DOCS = Path(__file__).resolve().parents[1] / "docs"


def test_the_nodes_parameters_are_documented_as_they_are_declared() -> None:
    text = (DOCS / "node.md").read_text(encoding="utf-8")
    assert to_markdown(NodeConfig()) in text
