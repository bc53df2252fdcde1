"""The paper's experiments: registers frames a fixed gap apart and compares with the truth."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.experiments.batch.journal import Journal, prepare
from rgbd_glue_ros.experiments.batch.workers import Failure, Pool, Serial
from rgbd_glue_ros.experiments.pairs.evaluation import PairResult
from rgbd_glue_ros.experiments.pairs.figures import gap_figures
from rgbd_glue_ros.experiments.pairs.gallery import Example, chosen, examples
from rgbd_glue_ros.experiments.pairs.jobs import (
    Pair,
    PairJob,
    Results,
    Unposed,
    from_json,
    pairs_of,
    run_job,
    to_json,
    true_poses,
)
from rgbd_glue_ros.experiments.pairs.methods import Estimator, method_of
from rgbd_glue_ros.experiments.pairs.page import render
from rgbd_glue_ros.experiments.pairs.tables import to_markdown
from rgbd_glue_ros.parameters import Config, values
from rgbd_glue_ros.recordings import Recording
from rgbd_glue_ros.whole_files import write_whole

logger = logging.getLogger(__name__)

JOURNAL, FIGURES, TABLES, REPORT = "pairs.jsonl", "pairs.json", "pairs.md", "report.html"

GLUE = "glue"
"""The name of the configuration's own method among those of an experiment."""


@dataclass
class Experiment:
    """Pairs registered so far.

    Attributes:
        config: of the registration.
        gaps: frames between the two of a pair.
        every: a pair starts at every so many frames; None takes the gap itself, so that each pair
            starts where the last one ended, as in UR&R's test split.
        others: methods that are measured on the same pairs, by name.
        results: of every pair, by method and gap.
        sources: recordings that pairs were taken of.
        problems: what kept others, or a part of these, from being used.
        absent: why a method could not be had, by its name.
    """

    config: Config
    gaps: Sequence[int]
    every: int | None = None
    others: Mapping[str, Estimator] = field(default_factory=dict)
    results: dict[str, dict[int, list[PairResult]]] = field(default_factory=dict)
    sources: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    absent: dict[str, str] = field(default_factory=dict)

    def add(self, results: Results) -> None:
        """Takes up the results of a pair."""
        for name, result in results.items():
            by_gap = self.results.setdefault(name, {})
            by_gap.setdefault(result.source - result.target, []).append(result)

    def figures(self) -> dict[str, Any]:
        """The content of ``pairs.json``; ratios, accuracies and recall are in percent."""
        parameters = values(self.config)
        by_method = {
            name: {str(gap): gap_figures(by_gap[gap]) for gap in sorted(by_gap)}
            for name, by_gap in self.results.items()
        }
        return {
            "features": {side: parameters[f"features.{side}"] for side in ("visual", "geometric")},
            "sources": self.sources,
            "problems": self.problems,
            "every": self.every,
            "gaps": by_method[GLUE],
            "others": {name: {"gaps": gaps} for name, gaps in by_method.items() if name != GLUE},
            "absent": self.absent,
            "parameters": parameters,
        }

    def write(self, folder: Path, shown: Sequence[Example] = ()) -> dict[str, Any]:
        """Writes the figures, the tables of them, and the report with pictures of some pairs."""
        figures = self.figures()
        text = json.dumps(figures, indent=2, allow_nan=False)
        write_whole(folder / FIGURES, text + "\n")
        write_whole(folder / TABLES, to_markdown(figures))
        page = render(figures, self.results, GLUE, self.config, shown)
        write_whole(folder / REPORT, page)
        return figures


def run_pairs(
    sources: Iterable[Path],
    open_source: Callable[[Path], Recording],
    experiment: Experiment,
    folder: Path,
    *,
    pool: Pool | None = None,
    on_planned: Callable[[int, int], None] = lambda *_: None,
    on_pair: Callable[[Results], None] = lambda _: None,
) -> dict[str, Any]:
    """Runs an experiment over recordings; what cannot be used is reported, the rest goes on.

    Every result is in ``JOURNAL`` as soon as it is known, and a run that broke off is gone on with.
    However it ends, the figures of the pairs done are written, and they are the same in whatever
    order the pairs were done.

    Args:
        sources: the recordings.
        open_source: opens one; with workers it has to be such as can be sent to them.
        experiment: takes up the results.
        folder: where the results go; created if it is not there.
        pool: where the work is done; None does it in this process.
        on_planned: called with the number of pairs, at most, and of those done by an earlier run.
        on_pair: called after every pair with its results by method.

    Returns:
        The figures, as ``Experiment.figures`` gives them.

    Raises:
        InputError: the folder cannot be written, holds a part of another experiment, or there was
            no pair at all.
        MissingExtraError: a feature needs a library that is not installed.
    """
    pool = pool or Serial()
    estimators, camera = _estimators(experiment), experiment.config.camera
    prepare(folder)
    plan, unusable = _planned(sources, open_source, experiment)
    with Journal(folder / JOURNAL, _about(experiment, estimators)) as journal:
        collected = _Collected(journal, unusable)
        on_planned(sum(map(len, plan.values())), len(collected.found))
        missing = {path: collected.missing(path, pairs) for path, pairs in plan.items()}
        size = pool.batch_size(sum(map(len, missing.values())))
        jobs = [
            PairJob(path, open_source, tuple(pairs[i : i + size]), estimators, camera)
            for path, pairs in missing.items()
            for i in range(0, len(pairs), size)
        ]
        try:
            for job, outcome in pool.run(run_job, jobs):
                if isinstance(outcome, dict):
                    collected.add(job.path, outcome)
                    on_pair(outcome)
                else:
                    collected.report(job.path, outcome)
            if not collected.problems:
                journal.finish()
        finally:
            collected.hand_over(experiment, plan)
            if experiment.results:
                experiment.write(folder)
                for problem in experiment.problems:
                    logger.warning("%s", problem)
    if not experiment.results:
        if unusable:
            raise unusable[0]
        gap = min(experiment.gaps)
        raise InputError("--gap", f"no two frames with a true pose are {gap} apart", "give less")
    shown = chosen([(path, results[GLUE]) for path, results in collected.in_order(plan)])
    pictures = examples(shown, open_source, method_of(experiment.config), camera)
    return experiment.write(folder, pictures)


class _Collected:
    """Results as they come, by recording and pair, and what went wrong.

    Attributes:
        found: results by their keys in the journal.
        problems: that may be gone when the experiment is run again.
        unusable: recordings, or parts of them, with the reason.
    """

    def __init__(self, journal: Journal, unusable: list[InputError]) -> None:
        self._journal = journal
        self._unposed: dict[Path, set[int]] = {}
        self.found = {key: from_json(content) for key, content in journal.done.items()}
        self.unusable = unusable
        self.problems = [str(error) for error in unusable]

    def missing(self, path: Path, pairs: Iterable[Pair]) -> list[Pair]:
        """Those of a recording's pairs that have no results yet."""
        return [pair for pair in pairs if _key(path, pair) not in self.found]

    def add(self, path: Path, results: Results) -> None:
        """Takes the results of a pair."""
        one = next(iter(results.values()))
        key = _key(path, (one.target, one.source))
        self.found[key] = results
        self._journal.add(key, to_json(results))

    def report(self, path: Path, outcome: Unposed | InputError | Failure) -> None:
        """Takes what came in place of results."""
        if isinstance(outcome, Unposed):
            self._unposed.setdefault(path, set()).add(outcome.index)
        elif isinstance(outcome, Failure):
            self.problems.append(f"{path}: {outcome.error}")
        else:
            self.problems.append(str(outcome))
            self.unusable.append(outcome)

    def in_order(self, plan: Mapping[Path, Iterable[Pair]]) -> Iterator[tuple[Path, Results]]:
        """The results there are, with their recordings, in the order of the plan."""
        for path, pairs in plan.items():
            for pair in pairs:
                if _key(path, pair) in self.found:
                    yield path, self.found[_key(path, pair)]

    def hand_over(self, experiment: Experiment, plan: Mapping[Path, Iterable[Pair]]) -> None:
        """Gives all to the experiment, the results in the order of the plan."""
        for _, results in self.in_order(plan):
            experiment.add(results)
        # a recording that is damaged fails every batch that comes to the place
        experiment.problems += dict.fromkeys(self.problems)
        experiment.problems += [
            f"{path}: frames without a true pose, left out: {len(indices)}"
            for path, indices in self._unposed.items()
        ]


def _planned(
    sources: Iterable[Path], open_source: Callable[[Path], Recording], experiment: Experiment
) -> tuple[dict[Path, list[Pair]], list[InputError]]:
    """The pairs of each recording, and what is wrong with those that cannot be used."""
    plan: dict[Path, list[Pair]] = {}
    unusable: list[InputError] = []

    def add(path: Path) -> None:
        try:
            with open_source(path) as recording:
                true_poses(recording)
                plan[path] = pairs_of(recording.frame_count, experiment.gaps, experiment.every)
                experiment.sources.append(recording.name)
        except InputError as error:
            unusable.append(error)

    for path in sources:
        add(path)
    return plan, unusable


def _key(path: Path, pair: Pair) -> str:
    return f"{path}:{pair[0]}-{pair[1]}"


def _about(
    experiment: Experiment, estimators: Iterable[tuple[str, Estimator]]
) -> Mapping[str, Any]:
    """What a pair's results depend on."""
    return {
        "parameters": values(experiment.config),
        "methods": {
            name: values(estimator) if isinstance(estimator, Config) else estimator
            for name, estimator in estimators
        },
    }


def _estimators(experiment: Experiment) -> tuple[tuple[str, Estimator], ...]:
    """The experiment's methods, less the others that cannot be had, which is a problem of it.

    Raises:
        MissingExtraError: the configuration's own method needs a library that is not installed.
    """
    method_of(experiment.config)
    usable: list[tuple[str, Estimator]] = [(GLUE, experiment.config)]

    def add(name: str, estimator: Estimator) -> None:
        try:
            method_of(estimator)
            usable.append((name, estimator))
        except (InputError, MissingExtraError) as error:
            experiment.absent[name] = str(error)
            experiment.problems.append(f"{name}: {error}")

    for name, estimator in experiment.others.items():
        add(name, estimator)
    return tuple(usable)
