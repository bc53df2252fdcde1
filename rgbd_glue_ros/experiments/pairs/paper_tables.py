"""The paper's tables in their own layout, with its figures and those measured here.

``paper_tables.yaml`` contains the paper's figures, and the corresponding configurations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import Any

import yaml

from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.evaluation.registration_errors import THRESHOLDS
from rgbd_glue_ros.experiments.pairs.evaluation import INLIER_THRESHOLDS_CM
from rgbd_glue_ros.experiments.pairs.methods import Estimator
from rgbd_glue_ros.experiments.pairs.metrics import METRICS, Metric
from rgbd_glue_ros.experiments.report import markdown
from rgbd_glue_ros.features.weights import require
from rgbd_glue_ros.files.writing import write_whole
from rgbd_glue_ros.parameters import Config, with_values

_LIGHTGLUE = (
    "LightGlue here is LighterGlue on XFeat's features; the paper's is LightGlue on SuperPoint's, "
    "whose weights are for research only."
)


@dataclass(frozen=True)
class Column:
    """A column of figures.

    Attributes:
        title: of the column.
        path: where in the figures of a gap it is; ``{side}`` and ``{range}`` are the row's.
        digits: decimal places.
    """

    title: str
    path: tuple[str, ...]
    digits: int = 1


def _bound(metric: Metric, limit: float) -> str:
    return f"{metric.short} ≤ {limit:g} {metric.unit}"


def _accuracy(*names: str) -> dict[str, list[Column]]:
    return {
        name: [
            Column(_bound(METRICS[name], limit), (name, "accuracy", f"{limit:g}"))
            for limit in THRESHOLDS[name]
        ]
        for name in names
    }


def _statistic(name: str, statistic: str, title: str) -> Column:
    return Column(f"{METRICS[name].short} {title}", (name, statistic))


def _errors() -> list[Column]:
    columns = []
    for name, accuracies in _accuracy(*THRESHOLDS).items():
        columns += accuracies
        columns += [_statistic(name, "mean", "mean"), _statistic(name, "median", "med.")]
    return columns


def _spacing() -> list[Column]:
    columns = []
    for name, accuracies in _accuracy("rotation_deg", "translation_cm").items():
        columns += [*accuracies, _statistic(name, "median", "med.")]
    return columns


def _inlier_ratios(*path: str) -> list[Column]:
    return [Column(f"ratio {limit:g} cm", (*path, f"{limit:g}")) for limit in INLIER_THRESHOLDS_CM]


_RECALL = Column("filter recall", ("filter_recall",))

COLUMNS: dict[str, list[Column]] = {
    "errors": _errors(),
    "inliers": [
        *_inlier_ratios("inlier_ratio", "{side}"),
        *(
            Column(f"amount {limit:g} cm", ("inlier_amount", "{side}", f"{limit:g}"), digits=0)
            for limit in INLIER_THRESHOLDS_CM
        ),
        _RECALL,
    ],
    "filter": [
        *(c for columns in _accuracy("rotation_deg", "translation_cm").values() for c in columns),
        *_inlier_ratios("inlier_ratio", "after"),
        _RECALL,
    ],
    "spacing": _spacing(),
    "threshold": [
        Column("matches", ("epsilon_squared_ranges", "{range}", "visual_matches"), digits=0),
        *_inlier_ratios("epsilon_squared_ranges", "{range}", "visual_inlier_ratio"),
    ],
}
"""The columns of each layout, in the paper's order."""


@dataclass(frozen=True)
class Row:
    """A row of a table.

    Attributes:
        group: its heading.
        name: of the row.
        gap: frames between the two of a pair.
        paper: the paper's figures, None where it has none; empty for our own row.
        features: the visual and the geometric feature; empty for another method.
        k: K of equation 4; None takes the paper's.
        peer: another method that is measured; empty for one that is only cited.
        side: of the filter.
        range: number of the range of the threshold.
    """

    group: str
    name: str
    gap: int
    paper: Sequence[float | None]
    features: str = ""
    k: float | None = None
    peer: str = ""
    side: str = "after"
    range: int = 0

    @property
    def method(self) -> str:
        """Rows of one method are measured by the same registrations; empty if only cited."""
        if not self.features:
            return self.peer
        return self.features if self.k is None else f"{self.features} K={self.k:g}"

    def estimator(self, base: Config) -> Estimator:
        """What measures the row.

        Raises:
            InputError: a feature or its weights are not available.
            MissingExtraError: a library is not installed.
        """
        if not self.features:
            return self.peer
        visual, geometric = self.features.split()
        config = with_values(
            base,
            {
                "features.visual": visual,
                "features.geometric": geometric,
                "glue.k": float(self.k or 0),
            },
        )
        require(config.features)
        return config


@dataclass(frozen=True)
class PaperTable:
    """A table of the paper.

    Attributes:
        number: as the paper numbers it.
        caption: what it shows.
        data: data set of the paper's figures.
        columns: layout, one of ``COLUMNS``.
        rows: in order.
    """

    number: str
    caption: str
    data: str
    columns: str
    rows: tuple[Row, ...]

    @property
    def gaps(self) -> list[int]:
        """The gaps of the rows that can be measured."""
        return sorted({row.gap for row in self.rows})

    def others(self, base: Config) -> dict[str, Estimator]:
        """The estimators of the rows, by method, except the configuration itself."""
        estimators, _ = self.estimators(base)
        return {name: estimator for name, estimator in estimators.items() if estimator != base}

    def estimators(self, base: Config) -> tuple[dict[str, Estimator], dict[str, str]]:
        """The estimators of the rows, by method, and why others are not available."""
        estimators: dict[str, Estimator] = {}
        absent: dict[str, str] = {}
        for row in self.rows:
            if row.method:
                _add(row, base, estimators, absent)
        return estimators, absent


def _add(row: Row, base: Config, estimators: dict[str, Estimator], absent: dict[str, str]) -> None:
    try:
        estimators[row.method] = row.estimator(base)
    except InputError as error:
        absent[row.method] = f"{error.where} {error.cause}"
    except MissingExtraError as error:
        absent[row.method] = f"{error.library} is not installed"


@lru_cache(maxsize=1)
def paper_tables() -> dict[str, PaperTable]:
    """All tables of the paper, by number."""
    text = Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")
    return {
        number: PaperTable(
            number,
            content["caption"],
            content["data"],
            content["columns"],
            tuple(Row(**{**row, "paper": tuple(row["paper"])}) for row in content["rows"]),
        )
        for number, content in yaml.safe_load(text).items()
    }


def paper_table(number: str) -> PaperTable:
    """A table by its number.

    Raises:
        InputError: there is no such table.
    """
    tables = paper_tables()
    if number.upper() not in tables:
        raise InputError(f"--table {number}", "no such table", f"use one of {', '.join(tables)}")
    return tables[number.upper()]


def render(
    table: PaperTable,
    measured: Mapping[str, Mapping[str, Mapping[str, Any]]],
    absent: Mapping[str, str],
    recordings: Sequence[str],
) -> str:
    """The table in Markdown.

    Args:
        table: to fill in.
        measured: figures by method and gap, as ``gap_figures`` gives them.
        absent: why other methods were not measured, by method.
        recordings: names of the measured recordings.
    """
    columns = COLUMNS[table.columns]
    lines = [
        f"# Table {table.number}: {table.caption}",
        "",
        f"Paper: on {table.data}, as printed. Here: on {', '.join(recordings)}.",
    ]
    if any("lightglue" in row.features for row in table.rows):
        lines.append(_LIGHTGLUE)
    for group, rows in groupby(table.rows, key=lambda row: row.group):
        cells = [
            line
            for row in rows
            for line in _lines(row, columns, measured.get(row.method, {}), absent)
        ]
        head = ["", "", "pairs", *(column.title for column in columns)]
        lines += ["", f"**{group}**", "", markdown.table(head, cells)]
    return "\n".join(lines) + "\n"


def _lines(
    row: Row,
    columns: Sequence[Column],
    measured: Mapping[str, Mapping[str, Any]],
    absent: Mapping[str, str],
) -> list[list[str]]:
    lines = []
    if row.paper:
        source = "paper" if row.method else "paper, cited, not measured"
        figures = [markdown.number(v, c.digits) for v, c in zip(row.paper, columns, strict=True)]
        lines.append([row.name, source, "", *figures])
    if str(row.gap) in measured:
        figures_here = measured[str(row.gap)]
        figures = [markdown.number(_at(figures_here, row, c), c.digits) for c in columns]
        lines.append([row.name, "here", str(_pairs(figures_here, row, columns)), *figures])
    elif row.method:
        why = absent.get(row.method, f"no pairs {row.gap} frames apart")
        lines.append([row.name, f"here: {why}", "", *[""] * len(columns)])
    return lines


def _pairs(figures: Mapping[str, Any], row: Row, columns: Sequence[Column]) -> int:
    """The number of pairs behind the figures of a row."""
    first = columns[0].path[0]
    part = figures[first][row.range] if first == "epsilon_squared_ranges" else figures
    return int(part["pairs"])


def _at(figures: Any, row: Row, column: Column) -> float | None:
    for name in column.path:
        key = name.format(side=row.side, range=row.range)
        figures = figures[int(key)] if isinstance(figures, list) else figures[key]
    value: float | None = figures
    return value


def write_table(table: PaperTable, config: Config, figures: dict[str, Any], folder: Path) -> Path:
    """Writes a table of the paper with the measurements.

    Args:
        table: to fill in.
        config: of the experiment.
        figures: of the experiment, as ``run_pairs`` returns them.
        folder: of the file.

    Returns:
        The file, in Markdown.
    """
    estimators, absent = table.estimators(config)
    measured = {
        name: figures["gaps"] if estimator == config else figures["others"][name]["gaps"]
        for name, estimator in estimators.items()
        if name not in figures["absent"]
    }
    text = render(table, measured, {**figures["absent"], **absent}, figures["sources"])
    path = folder / f"table_{table.number}.md"
    write_whole(path, text)
    return path
