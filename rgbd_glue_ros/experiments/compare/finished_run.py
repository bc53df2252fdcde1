"""Reads the output folder of a replay."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.replay.batch import FIGURES, named
from rgbd_glue_ros.experiments.replay.result_names import METRICS, PARAMETERS, TRAJECTORY
from rgbd_glue_ros.files.reading import read_text
from rgbd_glue_ros.parameters import parameter_values
from rgbd_glue_ros.trajectories.tum import read_tum
from rgbd_glue_ros.types import Trajectory

_GIVE_A_RUN = "give the output folder (-o) of rgbd-glue replay"
_RUN_AGAIN = "run rgbd-glue replay again"
# What every version wrote.
_NEEDED = ("sequence", "frames", "tracked", "lost", "latency_ms")


@dataclass(frozen=True)
class FinishedRun:
    """What a replay left behind.

    Attributes:
        name: of its folder, told apart from those of the other runs.
        folder: where it lies.
        figures: the content of ``metrics.json``.
        parameters: the values in ``params.yaml`` by their dotted names; None without that file.
        trajectory: its poses; None if no frame was tracked.
    """

    name: str
    folder: Path
    figures: Mapping[str, Any]
    parameters: Mapping[str, object] | None
    trajectory: Trajectory | None

    @property
    def recording(self) -> str:
        """The name of the recording that was replayed."""
        return str(self.figures["sequence"])

    @property
    def version(self) -> str:
        """That of the package which made it."""
        return str(self.figures.get("version") or "not known")


def read_runs(folders: Sequence[Path]) -> list[FinishedRun]:
    """The runs in some folders, in their order.

    Raises:
        InputError: a folder is given twice, or is not the output of a replay.
    """
    names = {folder: name for name, folder in named(folders).items()}
    for i, folder in enumerate(folders):
        if folder not in names or folder in folders[:i]:
            raise InputError(folder, "is given twice", "give each run once")
    return [_read(folder, names[folder]) for folder in folders]


def _read(folder: Path, name: str) -> FinishedRun:
    _check_folder(folder)
    figures = _figures(folder / METRICS)
    parameters = folder / PARAMETERS
    return FinishedRun(
        name,
        folder,
        figures,
        parameter_values(parameters) if parameters.exists() else None,
        read_tum(folder / TRAJECTORY) if figures.get("path_m") or figures["tracked"] else None,
    )


def _check_folder(folder: Path) -> None:
    if not folder.exists():
        raise InputError(folder, "does not exist", _GIVE_A_RUN)
    if not folder.is_dir():
        raise InputError(folder, "is not a folder", _GIVE_A_RUN)
    if (folder / METRICS).exists():
        return
    if (folder / FIGURES).exists():
        below = sorted(file.parent for file in folder.rglob(METRICS))
        remedy = f"give one of them, such as {below[0]}" if below else _GIVE_A_RUN
        raise InputError(folder, "holds the replays of many recordings", remedy)
    raise InputError(folder, f"holds no results of a replay ({METRICS} is missing)", _GIVE_A_RUN)


def _figures(file: Path) -> dict[str, Any]:
    try:
        figures = json.loads(read_text(file))
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(file, f"is no JSON ({error})", _RUN_AGAIN) from error
    missing = [key for key in _NEEDED if not isinstance(figures, dict) or key not in figures]
    if missing:
        raise InputError(file, f"holds no figures of a replay (no {missing[0]})", _RUN_AGAIN)
    return dict(figures)
