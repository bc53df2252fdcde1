"""Replays many recordings, in one process or many, with one table of them all."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.batch.journal import Journal
from rgbd_glue_ros.experiments.batch.opening import Opener
from rgbd_glue_ros.experiments.batch.workers import Failure, Pool, Serial
from rgbd_glue_ros.experiments.replay.replay import replay
from rgbd_glue_ros.experiments.replay.result_names import METRICS
from rgbd_glue_ros.experiments.replay.run_record import Provenance
from rgbd_glue_ros.experiments.replay.run_warnings import heard_warnings, named_warnings
from rgbd_glue_ros.experiments.report.markdown import NOTHING, bullets, table
from rgbd_glue_ros.files.writing import ResultFolder, json_text, write_whole
from rgbd_glue_ros.parameters import Config, values
from rgbd_glue_ros.recordings import refuse_recording
from rgbd_glue_ros.recordings.first_frames import first_frames

logger = logging.getLogger(__name__)

JOURNAL, FIGURES, TABLE = "replays.jsonl", "replays.json", "replays.md"


@dataclass(frozen=True)
class ReplayJob:
    """A recording to replay; everything that a process needs for it.

    Attributes:
        path: of the recording.
        open_recording: opens it.
        config: of the odometry.
        folder: where its results go.
        limit: number of frames to stop after; None takes all.
    """

    path: Path
    open_recording: Opener
    config: Config
    folder: Path
    limit: int | None


def run_replays(
    sources: Sequence[Path],
    open_source: Opener,
    config: Config,
    folder: Path,
    *,
    pool: Pool | None = None,
    limit: int | None = None,
    on_planned: Callable[[int, int], None] = lambda *_: None,
    on_replayed: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Replays recordings, each into its own folder; failures are reported.

    An interrupted run is continued: recordings that it finished are not replayed again.

    Args:
        sources: the recordings, at least one.
        open_source: opens one.
        config: of the odometry.
        folder: where the results go; created if it is not there.
        pool: executes the work; None does it in this process.
        limit: number of frames to stop after in each; None takes all.
        on_planned: called with the number of recordings, and of those done by an earlier run.
        on_replayed: called with the name of each recording that is done.

    Returns:
        The content of ``FIGURES``: under ``recordings`` the metrics of each by its name, and
        ``problems``.

    Raises:
        InputError: the folder cannot be written, contains a part of another run, or no recording
            could be replayed.
    """
    refuse_recording(folder)
    pool = pool or Serial()
    jobs = {
        name: ReplayJob(path, open_source, config, folder / name, limit)
        for name, path in named(sources).items()
    }
    problems: dict[str, str] = {}
    about = {
        "parameters": values(config),
        "limit": limit,
        "sources": {name: str(job.path.resolve()) for name, job in jobs.items()},
        "opening": open_source.as_json(),
    }
    with (
        ResultFolder(folder, (FIGURES, TABLE)),
        Journal(folder / JOURNAL, about) as journal,
    ):
        on_planned(len(jobs), len(journal.done))
        missing = [job for name, job in jobs.items() if name not in journal.done]
        try:
            for job, outcome in pool.run(run_job, missing):
                name = job.folder.relative_to(folder).as_posix()
                if isinstance(outcome, dict):
                    journal.add(name, outcome)
                else:
                    problems[name] = _said(job, outcome)
                    logger.warning("%s", problems[name])
                on_replayed(name)
            if not problems:
                journal.finish()
        finally:
            done = {name: journal.done[name] for name in jobs if name in journal.done}
            if done:
                figures = {"recordings": done, "problems": list(problems.values())}
                write_whole(folder / FIGURES, json_text(figures))
                write_whole(folder / TABLE, to_markdown(figures))
    if not done:
        raise InputError(
            folder, f"no recording could be replayed ({next(iter(problems.values()))})", "see above"
        )
    return figures


def run_job(job: ReplayJob) -> Iterator[dict[str, Any] | InputError]:
    """The metrics of a replayed recording, or its error."""
    try:
        with (
            named_warnings(str(job.path)),
            heard_warnings() as heard,
            job.open_recording(job.path) as recording,
        ):
            taken = first_frames(recording, job.limit)
            provenance = Provenance(job.open_recording.inputs, warnings=tuple(heard))
            replay(taken, job.config, job.folder, provenance=provenance)
    except InputError as error:
        yield error
        return
    yield json.loads((job.folder / METRICS).read_text(encoding="utf-8"))


def named(sources: Iterable[Path]) -> dict[str, Path]:
    """The recordings by their paths below their common folder."""
    # links keep their own names
    paths = {path: path.absolute() for path in sources}
    common = Path(os.path.commonpath([path.parent for path in paths.values()]))
    return {full.relative_to(common).as_posix(): path for path, full in paths.items()}


def to_markdown(figures: Mapping[str, Any]) -> str:
    """``TABLE`` from the content of ``FIGURES``."""
    head = [
        *("recording", "frames", "tracked (%)", "APE rmse (cm)", "RPE (cm/s)", "RPE (°/s)"),
        *("median latency (ms)", "frames/s"),
    ]
    rows = [_row(name, content) for name, content in figures["recordings"].items()]
    text = table(head, rows) + "\n"
    if figures["problems"]:
        text += f"\n{bullets(figures['problems'])}\n"
    return text


def _row(name: str, content: Mapping[str, Any]) -> list[str]:
    ape, rpe = content.get("ape"), content.get("rpe")
    return [
        name,
        str(content["frames"]),
        f"{100 * content['tracked'] / content['frames']:.1f}",
        f"{100 * ape['rmse_m']:.2f}" if ape else NOTHING,
        f"{100 * rpe['trans_rmse_m']:.2f}" if rpe else NOTHING,
        f"{rpe['rot_rmse_deg']:.2f}" if rpe else NOTHING,
        f"{content['latency_ms']['p50']:.1f}",
        f"{content['fps']:.1f}",
    ]


def _said(job: ReplayJob, outcome: InputError | Failure) -> str:
    return str(outcome) if isinstance(outcome, InputError) else f"{job.path}: {outcome.error}"
