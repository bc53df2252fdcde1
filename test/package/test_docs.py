"""What the documentation repeats of the code is what the code says."""

from __future__ import annotations

import re
import runpy
from collections.abc import Iterator
from pathlib import Path

import pytest
from rigs.paths import ROOT

from rgbd_glue_ros.parameters import NodeConfig, to_markdown

DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.glob("*.md"), *(ROOT / "bags").glob("*.md")])
FOLDERS = "bags|config|docs|examples|launch|rgbd_glue_ros|scripts|test"


def named_files(page: Path) -> Iterator[Path]:
    """The files that a page links to, or names by their paths in the checkout."""
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
        if "://" not in link:
            yield page.parent / link
    for path in re.findall(rf"(?<![\w/.-])((?:{FOLDERS})/[\w./-]*\w)", text):
        yield ROOT / path


def test_the_nodes_parameters_are_documented_as_they_are_declared() -> None:
    text = (DOCS / "node.md").read_text(encoding="utf-8")
    is_current = to_markdown(NodeConfig()) in text
    assert is_current, "paste what `rgbd-glue params --node --markdown` prints into docs/node.md"


def test_the_public_names_are_documented_as_their_docstrings_say() -> None:
    """``python scripts/api.py`` writes the page."""
    markdown = runpy.run_path(str(ROOT / "scripts" / "api.py"))["markdown"]
    assert (DOCS / "api.md").read_text(encoding="utf-8") == markdown()


def test_every_fault_in_the_documentation_names_tests_that_exist() -> None:
    rows = [
        line.split("|")
        for line in (DOCS / "robustness.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("|") and not line.startswith(("|---", "| fault |"))
    ]
    exist = {
        name
        for path in (ROOT / "test").rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    for _, fault, behaviour, tests, _ in rows:
        assert fault.strip()
        assert behaviour.strip()
        named = set(re.findall(r"`(\w+)`", tests))
        assert named, f"no test for {fault}"
        assert named <= exist, f"no such tests: {named - exist}"


def test_every_test_of_faults_is_in_the_documentation() -> None:
    text = (DOCS / "robustness.md").read_text(encoding="utf-8")
    for path in (ROOT / "test").rglob("test_faults*.py"):
        for name in re.findall(r"^def (test_\w+)", path.read_text(encoding="utf-8"), re.MULTILINE):
            assert f"`{name}`" in text


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_file_that_a_page_names_exists(page: Path) -> None:
    missing = {str(path) for path in named_files(page) if not path.exists()}
    assert not missing


def test_every_change_of_the_sensors_is_a_row_in_the_documentation_by_its_name() -> None:
    """``python scripts/sensors.py RECORDING... --only NAME`` measures the row again."""
    changes = runpy.run_path(str(ROOT / "scripts" / "sensors.py"))["CHANGES"]
    text = (DOCS / "hard_places.md").read_text(encoding="utf-8")
    rows = set(re.findall(r"^\| ([^|]+) \|", text, re.MULTILINE))
    assert set(changes) - {"as recorded"} <= rows
