"""Runs of one recording side by side: figures, and the parameters in which they differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.trajectory_errors import Evaluation, evaluated
from rgbd_glue_ros.experiments.compare.finished_run import FinishedRun
from rgbd_glue_ros.experiments.report.markdown import NOTHING, bullets, number, table
from rgbd_glue_ros.trajectories.association import associate


@dataclass(frozen=True)
class Comparison:
    """Runs of one recording.

    Attributes:
        runs: at least two.
        apart: of each run its trajectory compared with the first one's; None for the first, and
            where the two have too few moments in common.
    """

    runs: Sequence[FinishedRun]
    apart: Sequence[Evaluation | None]


@dataclass(frozen=True)
class Figure:
    """A figure of ``metrics.json`` as the table shows it.

    Attributes:
        title: with its unit.
        keys: that lead to it.
        digits: decimals.
        scale: by which the number is multiplied.
    """

    title: str
    keys: tuple[str, ...]
    digits: int = 0
    scale: float = 1.0

    def of(self, figures: Mapping[str, Any]) -> float | None:
        """Its value; None where a run has none, as an error without ground truth."""
        value = reduce(_below, self.keys, figures)
        return self.scale * float(value) if isinstance(value, (int, float)) else None

    def cells(self, comparison: Comparison) -> Iterator[str]:
        """Its values, with the ratio to that of the first run."""
        first, *others = (self.of(run.figures) for run in comparison.runs)
        yield number(first, self.digits)
        for value in others:
            ratio = f" (x {value / first:.2f})" if first and value is not None else ""
            yield f"{number(value, self.digits)}{ratio}"


def _below(content: Any, key: str) -> Any:
    return content.get(key) if isinstance(content, Mapping) else None


class _Apart:
    """How far a run is from the first, which no run knows of itself."""

    title = "apart from the first, rmse (cm)"

    def cells(self, comparison: Comparison) -> Iterator[str]:
        """The error of each run's trajectory against the first one's."""
        for apart in comparison.apart:
            yield number(None if apart is None else 100 * apart.ape.rmse_m, 2)


_ROWS: tuple[Figure | _Apart, ...] = (
    Figure("frames", ("frames",)),
    Figure("tracked", ("tracked",)),
    Figure("lost", ("lost",)),
    Figure("keyframes", ("keyframes",)),
    Figure("APE rmse (cm)", ("ape", "rmse_m"), 2, 100),
    Figure("drift, RPE rmse (cm/s)", ("rpe", "trans_rmse_m"), 2, 100),
    Figure("rotation drift, RPE rmse (°/s)", ("rpe", "rot_rmse_deg"), 3),
    _Apart(),
    Figure("length of path (m)", ("path_m",), 2),
    Figure("latency, median (ms)", ("latency_ms", "p50"), 1),
    Figure("latency, p95 (ms)", ("latency_ms", "p95"), 1),
    Figure("memory, peak (MB)", ("peak_rss_mb",)),
)


def compare(runs: Sequence[FinishedRun]) -> Comparison:
    """Compares runs with the first of them.

    Raises:
        InputError: a run is of another recording.
    """
    first, *others = runs
    for run in others:
        if run.recording != first.recording and not _share_moments(run, first):
            raise InputError(
                run.folder,
                f"is a run of {run.recording}, and {first.folder} one of {first.recording}",
                "compare runs of one recording",
            )
    return Comparison(runs, [None, *(_apart(run, first) for run in others)])


def _share_moments(run: FinishedRun, first: FinishedRun) -> bool:
    """Whether trajectories have stamps in common: a recording may have been converted."""
    if run.trajectory is None or first.trajectory is None:
        return False
    rows, _ = associate(run.trajectory.stamps_ns, first.trajectory.stamps_ns)
    return 2 * len(rows) > min(len(run.trajectory), len(first.trajectory))


def _apart(run: FinishedRun, first: FinishedRun) -> Evaluation | None:
    return None if run.trajectory is None else evaluated(run.trajectory, first.trajectory)


def figures_table(comparison: Comparison) -> str:
    """All figures, with the ratio to those of the first run; a column for each run."""
    rows = [[row.title, *row.cells(comparison)] for row in _ROWS]
    return _aligned(["", *(run.name for run in comparison.runs)], rows)


def parameters_text(runs: Sequence[FinishedRun]) -> str:
    """A table of the parameters in which runs differ, or that none does, and what is not known.

    Names the versions of the package if they differ.
    """
    known = [run for run in runs if run.parameters is not None]
    notes = [
        f"{run.name} holds no params.yaml: its parameters are not known"
        for run in runs
        if run.parameters is None
    ]
    if len({run.version for run in runs}) > 1:
        versions = ", ".join(f"{run.name} {run.version}" for run in runs)
        notes.append(f"the versions of rgbd_glue_ros differ: {versions}")
    rows = [[name, *map(_shown, values)] for name, values in differing_parameters(known).items()]
    if rows:
        text = _aligned(["parameter", *(run.name for run in known)], rows)
    elif len(known) > 1:
        text = "No parameter differs."
    else:
        text = "Parameters cannot be compared."
    return f"{text}\n\n{bullets(notes)}" if notes else text


def differing_parameters(runs: Sequence[FinishedRun]) -> dict[str, list[object]]:
    """The values of each run by the names of those that are not the same in all.

    A value is None where a run does not know the parameter, as one of another version.
    """
    all_values = [run.parameters or {} for run in runs]
    names = dict.fromkeys(name for values in all_values for name in values)
    found = {name: [values.get(name) for values in all_values] for name in names}
    return {name: values for name, values in found.items() if any(v != values[0] for v in values)}


def _shown(value: object) -> str:
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return str(value).lower()
    return "''" if value == "" else str(value)


def _aligned(head: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown whose columns also stand below each other in a terminal."""
    widths = np.array([[len(cell) for cell in row] for row in [head, *rows]]).max(axis=0)
    padded = [
        [cell.rjust(width) if i else cell.ljust(width) for i, (cell, width) in enumerate(line)]
        for line in (zip(row, widths.tolist(), strict=True) for row in [head, *rows])
    ]
    return table(padded[0], padded[1:])
