"""What an earlier run has left in the folder of a new one."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Collection
from pathlib import Path

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.replay.result_names import OF_SOME_RUNS
from rgbd_glue_ros.files.reading import read_text
from rgbd_glue_ros.recordings.bag.layout import METADATA

logger = logging.getLogger(__name__)

# Of what runs write elsewhere if asked to, and maybe here.
_SUFFIXES = (".ply", ".rrd", ".rgbdmap")


def recording_of(metrics: Path) -> str | None:
    """The recording that a file of figures is of; None if there is none."""
    try:
        return str(json.loads(read_text(metrics))["sequence"])
    except (InputError, ValueError, KeyError, TypeError):
        return None


def say_what_is_replaced(folder: Path, before: str | None, name: str, stale: list[str]) -> None:
    """Logs that results are replaced, and what stays of an earlier run beside the new ones.

    Args:
        folder: of the results.
        before: recording of the results that were there; None if there were none.
        name: of the recording that new ones are of.
        stale: names of what stays.
    """
    if before is None:
        return
    text = f"{folder}: replacing the results of {before}"
    if stale:
        text += f"; of an earlier run there stay {', '.join(stale)}"
    level = logging.INFO if before == name and not stale else logging.WARNING
    logger.log(level, "%s", text)


def stale_files(
    folder: Path, results: Collection[str], written: Collection[Path | None]
) -> list[str]:
    """Names of files and bags of runs in a folder that the next one does not replace.

    Args:
        folder: of the results.
        results: names of what the next run writes there.
        written: what it writes elsewhere, or beside these; None stands for nothing.
    """
    own = {os.path.realpath(path) for path in written if path is not None}
    return [
        f"{path.name}/" if path.is_dir() else path.name
        for path in sorted(folder.iterdir())
        if path.name not in results and os.path.realpath(path) not in own and _is_of_a_run(path)
    ]


def _is_of_a_run(path: Path) -> bool:
    if path.is_dir():
        return not path.name.startswith(".") and (path / METADATA).is_file()
    return path.name in OF_SOME_RUNS or path.suffix in _SUFFIXES
