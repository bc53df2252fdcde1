"""The paper's experiments: registers frames a fixed gap apart and compares with ground truth."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rgbd_glue_ros.closing import uninterrupted
from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.experiments.batch.journal import Journal
from rgbd_glue_ros.experiments.batch.opening import Opener
from rgbd_glue_ros.experiments.batch.workers import Pool, Serial
from rgbd_glue_ros.experiments.pairs.gallery import chosen, examples
from rgbd_glue_ros.experiments.pairs.jobs import (
    Pair,
    PairJob,
    Results,
    pairs_of,
    run_job,
    true_poses,
)
from rgbd_glue_ros.experiments.pairs.methods import Estimator, method_of
from rgbd_glue_ros.experiments.pairs.report import FIGURES, JOURNAL, REPORT, TABLES, write_report
from rgbd_glue_ros.experiments.pairs.results import GLUE, Plan, ResultCollector
from rgbd_glue_ros.experiments.replay.run_warnings import said_once
from rgbd_glue_ros.files.writing import ResultFolder
from rgbd_glue_ros.parameters import Config, values
from rgbd_glue_ros.recordings import refuse_recording

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Experiment:
    """What to measure.

    Attributes:
        config: of the registration.
        gaps: frames between the two of a pair.
        every: frames between starts of pairs; None takes the gap itself, so that each pair starts
            where the previous one ended, as in UR&R's test split.
        others: methods that are measured on the same pairs, by name.
    """

    config: Config
    gaps: Sequence[int]
    every: int | None = None
    others: Mapping[str, Estimator] = field(default_factory=dict)


def run_pairs(
    sources: Iterable[Path],
    open_source: Opener,
    experiment: Experiment,
    folder: Path,
    *,
    pool: Pool | None = None,
    on_planned: Callable[[int, int], None] = lambda *_: None,
    on_pair: Callable[[Results], None] = lambda _: None,
) -> dict[str, Any]:
    """Runs an experiment over recordings; unusable ones are reported, the rest continues.

    Every result is in ``JOURNAL`` as soon as it is known, and an interrupted run is continued.
    However it ends, the figures of the finished pairs are written, independent of the order in
    which the pairs were done.

    Args:
        sources: the recordings.
        open_source: opens one.
        experiment: what to measure.
        folder: where the results go; created if it is not there.
        pool: executes the work; None does it in this process.
        on_planned: called with the number of pairs, at most, and of those done by an earlier run.
        on_pair: called after every pair with its results by method.

    Returns:
        The figures, as ``PairResults.figures`` gives them.

    Raises:
        InputError: the folder cannot be written, contains a part of another experiment, or there
            was no pair at all.
        MissingExtraError: a feature needs a library that is not installed.
    """
    with said_once(), ResultFolder(folder, (FIGURES, TABLES, REPORT)):
        return _measured(
            sources, open_source, experiment, folder, pool or Serial(), on_planned, on_pair
        )


def _measured(
    sources: Iterable[Path],
    open_source: Opener,
    experiment: Experiment,
    folder: Path,
    pool: Pool,
    on_planned: Callable[[int, int], None],
    on_pair: Callable[[Results], None],
) -> dict[str, Any]:
    refuse_recording(folder)
    estimators, absent = _estimators(experiment)
    plan, names, unusable = _planned(sources, open_source, experiment)
    with Journal(folder / JOURNAL, _about(experiment, estimators, open_source)) as journal:
        collector = ResultCollector(journal, unusable)
        missing = collector.missing(plan)
        total = _count(plan)
        on_planned(total, total - _count(missing))
        jobs = _jobs(missing, open_source, estimators, experiment, pool)
        try:
            for job, outcome in pool.run(run_job, jobs):
                collector.add(job, outcome)
                if isinstance(outcome, dict):
                    on_pair(outcome)
            if not collector.problems:
                journal.finish()
        finally:
            results = collector.results(plan, names, absent)
            if results.by_method:
                with uninterrupted():
                    figures = results.figures(experiment.config, experiment.every)
                    write_report(folder, experiment.config, results, figures)
                for problem in results.problems:
                    logger.warning("%s", problem)
    if not results.by_method:
        if collector.unusable:
            raise collector.unusable[0]
        gap = min(experiment.gaps)
        raise InputError("--gap", f"no two frames with ground truth are {gap} apart", "give less")
    shown = chosen([(path, pair[GLUE]) for path, pair in collector.in_order(plan)])
    method = method_of(experiment.config)
    pictures = examples(shown, open_source, method, experiment.config.camera)
    with uninterrupted():
        write_report(folder, experiment.config, results, figures, pictures)
    return figures


def _planned(
    sources: Iterable[Path], open_source: Opener, experiment: Experiment
) -> tuple[Plan, list[str], list[InputError]]:
    """The pairs and the name of each recording, and the errors of unusable ones."""
    plan: dict[Path, list[Pair]] = {}
    names: list[str] = []
    unusable: list[InputError] = []

    def add(path: Path) -> None:
        try:
            with open_source(path) as recording:
                true_poses(recording)
                plan[path] = pairs_of(recording.frame_count, experiment.gaps, experiment.every)
                names.append(recording.name)
        except InputError as error:
            unusable.append(error)

    for path in sources:
        add(path)
    return plan, names, unusable


def _count(plan: Plan) -> int:
    """The number of pairs."""
    return sum(map(len, plan.values()))


def _jobs(
    missing: Plan,
    open_source: Opener,
    estimators: Mapping[str, Estimator],
    experiment: Experiment,
    pool: Pool,
) -> list[PairJob]:
    """The pairs in batches, each of one recording."""
    size = pool.batch_size(_count(missing))
    methods, camera = tuple(estimators.items()), experiment.config.camera
    return [
        PairJob(path, open_source, tuple(pairs[i : i + size]), methods, camera)
        for path, pairs in missing.items()
        for i in range(0, len(pairs), size)
    ]


def _about(
    experiment: Experiment, estimators: Mapping[str, Estimator], open_source: Opener
) -> Mapping[str, Any]:
    """Everything that a pair's results depend on besides the recording and its frames."""
    return {
        "parameters": values(experiment.config),
        "methods": {
            name: values(estimator) if isinstance(estimator, Config) else estimator
            for name, estimator in estimators.items()
        },
        "opening": open_source.as_json(),
    }


def _estimators(experiment: Experiment) -> tuple[dict[str, Estimator], dict[str, str]]:
    """The experiment's methods, and why others are not available.

    Raises:
        MissingExtraError: the configuration's own method needs a library that is not installed.
    """
    method_of(experiment.config)
    usable: dict[str, Estimator] = {GLUE: experiment.config}
    absent: dict[str, str] = {}

    def add(name: str, estimator: Estimator) -> None:
        try:
            method_of(estimator)
            usable[name] = estimator
        except (InputError, MissingExtraError) as error:
            absent[name] = str(error)

    for name, estimator in experiment.others.items():
        add(name, estimator)
    return usable, absent
