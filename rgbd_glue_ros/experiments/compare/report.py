"""Writes the report of compared runs to a folder of its own."""

from __future__ import annotations

from pathlib import Path

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.compare.comparison import Comparison
from rgbd_glue_ros.experiments.compare.page import render
from rgbd_glue_ros.experiments.replay.result_names import METRICS, REPORT
from rgbd_glue_ros.files.writing import ResultFolder, write_whole
from rgbd_glue_ros.recordings import refuse_recording


def write_report(comparison: Comparison, folder: Path, command: str = "") -> Path:
    """Writes the page, and returns where it is.

    Args:
        comparison: of the runs.
        folder: destination; created if it does not exist.
        command: the command line, for quoting in the report.

    Raises:
        InputError: the folder is that of a run or a recording, cannot be written, or another run
            is writing to it.
    """
    if (folder / METRICS).exists():
        raise InputError(
            folder, f"holds a run, whose {REPORT} would be replaced", "give another folder (-o)"
        )
    refuse_recording(folder)
    with ResultFolder(folder, (REPORT,)):
        write_whole(folder / REPORT, render(comparison, command))
    return folder / REPORT
