"""The paper's tables: all that it prints is there, in its layout, with what was measured beside."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.registration_errors import THRESHOLDS, RegistrationErrors
from rgbd_glue_ros.experiments.pairs.evaluation import Inliers, PairResult
from rgbd_glue_ros.experiments.pairs.figures import gap_figures
from rgbd_glue_ros.experiments.pairs.paper_tables import (
    COLUMNS,
    PaperTable,
    paper_table,
    paper_tables,
    render,
)
from rgbd_glue_ros.experiments.peers import PEERS
from rgbd_glue_ros.features.weights import FILES
from rgbd_glue_ros.parameters import Config, load_preset, with_values

HAND_CRAFTED = ("none", "sift", "orb", "brisk")
NUMBERS = ["1", "2", "3", "4", "5", "6", "S1", "S2", "S3"]


def figures() -> dict[str, Any]:
    """Of two pairs, as an experiment has them."""
    results = [
        PairResult(
            recording="walk",
            source=20,
            target=0,
            errors=RegistrationErrors(rotation, 2.0, 0.5),
            visual=Inliers(10, (8, 6, 4)),
            before=Inliers(100, (40, 20, 10)),
            after=Inliers(50, (40, 20, 10)),
            filtered=True,
            epsilon_m=0.05,
            seconds=0.5,
            stages_ms={},
        )
        for rotation in (1.0, 6.0)
    ]
    return gap_figures(results)


def rendered(table: PaperTable) -> list[list[str]]:
    """The cells of the table's lines, all that can be measured here measured alike."""
    methods = table.estimators(load_preset("paper"))[0]
    here = {method: {str(gap): figures() for gap in table.gaps} for method in methods}
    text = render(table, here, {}, ["walk"])
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith("|")
    ]


def test_every_table_of_the_paper_is_known_and_others_are_refused() -> None:
    assert [*paper_tables()] == NUMBERS
    assert paper_table("s1").number == "S1"
    with pytest.raises(InputError, match="use one of 1, 2, 3"):
        paper_table("7")


@pytest.mark.parametrize("number", NUMBERS)
def test_a_row_has_a_figure_for_every_column_of_its_layout(number: str) -> None:
    table = paper_table(number)
    for row in table.rows:
        assert len(row.paper) in {0, len(COLUMNS[table.columns])}, row.name


@pytest.mark.parametrize("number", NUMBERS)
def test_accuracy_as_printed_does_not_fall_where_the_threshold_rises(number: str) -> None:
    """A figure mistyped would in most cases break the order."""
    table = paper_table(number)
    paths = [column.path for column in COLUMNS[table.columns]]
    for row in (row for row in table.rows if row.paper):
        for name in THRESHOLDS:
            accuracies = [
                figure or 0.0
                for path, figure in zip(paths, row.paper, strict=True)
                if path[:2] == (name, "accuracy")
            ]
            assert accuracies == sorted(accuracies), row.name


def test_figures_are_those_that_the_paper_prints() -> None:
    def printed(number: str, name: str, gap: int, group: str = "") -> list[float | None]:
        rows = [
            row
            for row in paper_table(number).rows
            if (row.name, row.gap) == (name, gap) and group in row.group and row.paper
        ]
        assert len(rows) == 1
        return [*rows[0].paper]

    assert printed("1", "PointMBF", 20, "ScanNet")[0] == 96.0
    assert printed("2", "FCGF + VBReg", 40)[13] == 15.7
    assert printed("3", "SIFT", 20, "FPFH")[:5] == [86.9, 91.4, 96.9, 6.4, 0.9]
    assert printed("4", "LightGlue", 20, "FCGF") == [97.5, 82.3, 41.5, 2303, 1973, 968, 99.4]
    assert printed("5", "K = 7", 20, "SIFT")[-1] == 97.2
    assert printed("6", "PEAL", 60) == [62.5, 68.6, 77.2, 2.5, 39.1, 57.2, 67.8, 7.2]
    assert printed("S1", "Before Filtering, LightGlue + FCGF", 60)[6] is None
    assert printed("S2", "ORB", 20, "FCGF")[-2:] == [9.9, 0.1]
    assert printed("S3", "0.008 to 0.01 m²", 20) == [227, 80.7, 58.7, 31.4]


@pytest.mark.parametrize("number", NUMBERS)
def test_every_table_has_rows_that_can_be_measured_without_weights(number: str) -> None:
    table = paper_table(number)
    estimators, absent = table.estimators(load_preset("paper"))
    assert not {*estimators} & {*absent}
    for method, estimator in estimators.items():
        if isinstance(estimator, Config):
            visual, geometric = method.split()[:2]
            assert (estimator.features.visual, estimator.features.geometric) == (visual, geometric)
        else:
            assert estimator in PEERS
    cells = rendered(table)
    assert [line for line in cells if line[1] == "here"]


def test_k_is_the_papers_unless_the_table_is_about_it() -> None:
    base = load_preset("paper")
    estimators, _ = paper_table("5").estimators(base)
    ks = [e.glue.k for e in estimators.values() if isinstance(e, Config)]
    assert ks == [1, 3, 5, 7]
    estimators, _ = paper_table("3").estimators(base)
    assert {e.k for e in estimators.values() if isinstance(e, Config)} == {5}
    assert {row.k for row in paper_table("3").rows} == {None}


@pytest.mark.parametrize("number", NUMBERS)
def test_with_all_weights_every_row_of_features_is_measured(number: str, tmp_path: Path) -> None:
    pytest.importorskip("torch")
    for name in FILES:
        (tmp_path / name).touch()
    base = with_values(load_preset("paper"), {"features.weights": str(tmp_path)})
    estimators, absent = paper_table(number).estimators(base)
    assert not absent
    for row in paper_table(number).rows:
        estimator = estimators.get(row.method)
        if isinstance(estimator, Config) and row.k is None:
            assert estimator.k == (5 if row.features.split()[0] in HAND_CRAFTED else 3)


def test_what_was_measured_stands_below_what_the_paper_prints() -> None:
    cells = rendered(paper_table("3"))
    row = cells.index(next(line for line in cells if line[:2] == ["SIFT", "paper"]))
    assert cells[row][3:8] == ["76.1", "85.8", "97.2", "7.7", "2.0"]
    assert cells[row + 1][:8] == ["SIFT", "here", "2", "50.0", "100.0", "100.0", "3.5", "3.5"]


def test_sides_of_the_filter_and_ranges_of_the_threshold_are_told_apart() -> None:
    before, after = (
        next(
            line
            for line in rendered(paper_table("S1"))
            if line[0].startswith(side) and "here" in line
        )
        for side in ("Before", "After")
    )
    assert before[3] == "40.0"
    assert after[3] == "80.0"
    ranges = [line for line in rendered(paper_table("S3")) if line[1] == "here"]
    assert [line[2] for line in ranges] == ["0", "2", "0", "0", "0"]
    assert ranges[1][3:] == ["10", "80.0", "60.0", "40.0"]
    assert ranges[0][3:] == ["–"] * 4


def test_a_method_that_is_only_cited_says_so_and_one_that_is_absent_why() -> None:
    table = paper_table("1")
    _, absent = table.estimators(load_preset("paper"))
    text = render(table, {}, absent, ["walk"])
    assert "| PEAL | paper, cited, not measured | | 94.4 |" in " ".join(text.split("  "))
    # without the extra, without weights, or with a feature that there is not
    assert re.search(r"here: .*(is not installed|are missing|is not known)", text)
    assert "no pairs 20 frames apart" in text
    assert "on ScanNet, as printed. Here: on walk." in text
