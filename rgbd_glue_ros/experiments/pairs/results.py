"""The results of an experiment, and its figures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.batch.journal import Journal
from rgbd_glue_ros.experiments.batch.workers import Failure
from rgbd_glue_ros.experiments.pairs.evaluation import PairResult
from rgbd_glue_ros.experiments.pairs.figures import gap_figures
from rgbd_glue_ros.experiments.pairs.jobs import (
    Pair,
    PairJob,
    Results,
    Unposed,
    from_json,
    to_json,
)
from rgbd_glue_ros.parameters import Config, values

GLUE = "glue"
"""The name of the configuration's own method among those of an experiment."""

ByGap = Mapping[int, Sequence[PairResult]]
"""Results of one method, by the number of frames between the two of a pair."""

Plan = Mapping[Path, Sequence[Pair]]
"""The pairs to register of each recording."""


@dataclass(frozen=True)
class PairResults:
    """The results of the finished pairs.

    Attributes:
        by_method: of every pair, in the order of the plan.
        sources: names of the recordings with planned pairs.
        problems: why recordings, pairs or methods could not be used.
        absent: why a method was not available, by its name.
    """

    by_method: Mapping[str, ByGap]
    sources: Sequence[str]
    problems: Sequence[str]
    absent: Mapping[str, str]

    def figures(self, config: Config, every: int | None) -> dict[str, Any]:
        """The content of ``pairs.json``; ratios, accuracies and recall are in percent.

        Args:
            config: of the experiment.
            every: of the experiment.
        """
        parameters = values(config)
        by_method = {
            name: {str(gap): gap_figures(by_gap[gap]) for gap in sorted(by_gap)}
            for name, by_gap in self.by_method.items()
        }
        return {
            "features": {side: parameters[f"features.{side}"] for side in ("visual", "geometric")},
            "sources": list(self.sources),
            "problems": list(self.problems),
            "every": every,
            "gaps": by_method[GLUE],
            "others": {name: {"gaps": gaps} for name, gaps in by_method.items() if name != GLUE},
            "absent": dict(self.absent),
            "parameters": parameters,
        }


class ResultCollector:
    """Collects results as they arrive, and keeps each in a journal.

    Attributes:
        unusable: recordings, or parts of them, with the reason.
        problems: temporary ones, which may be gone in the next run.
    """

    def __init__(self, journal: Journal, unusable: Sequence[InputError]) -> None:
        """Loads the results of an earlier run.

        Args:
            journal: of the experiment.
            unusable: recordings without any planned pair.
        """
        self._journal = journal
        self._unposed: dict[Path, set[int]] = {}
        self._results = {key: from_json(content) for key, content in journal.done.items()}
        self.unusable = list(unusable)
        self.problems = [str(error) for error in unusable]

    def missing(self, plan: Plan) -> dict[Path, list[Pair]]:
        """The pairs of a plan that have no results yet."""
        return {
            path: [pair for pair in pairs if _key(path, pair) not in self._results]
            for path, pairs in plan.items()
        }

    def add(self, job: PairJob, outcome: Results | Unposed | InputError | Failure) -> None:
        """Adds the results of a pair, or the error in their place."""
        if isinstance(outcome, Unposed):
            self._unposed.setdefault(job.path, set()).add(outcome.index)
        elif isinstance(outcome, Failure):
            self.problems.append(f"{job.path}: {outcome.error}")
        elif isinstance(outcome, InputError):
            self.problems.append(str(outcome))
            self.unusable.append(outcome)
        else:
            one = next(iter(outcome.values()))
            key = _key(job.path, (one.target, one.source))
            self._results[key] = outcome
            self._journal.add(key, to_json(outcome))

    def in_order(self, plan: Plan) -> Iterator[tuple[Path, Results]]:
        """The existing results, with their recordings, in the order of the plan."""
        for path, pairs in plan.items():
            for pair in pairs:
                if _key(path, pair) in self._results:
                    yield path, self._results[_key(path, pair)]

    def results(self, plan: Plan, sources: Sequence[str], absent: Mapping[str, str]) -> PairResults:
        """All results, independent of the order of arrival."""
        problems = [
            *(f"{name}: {reason}" for name, reason in absent.items()),
            # a damaged recording fails every batch that reaches the damage
            *dict.fromkeys(self.problems),
            *(
                f"{path}: frames without ground truth, skipped: {len(indices)}"
                for path, indices in self._unposed.items()
            ),
        ]
        by_method = _by_method(results for _, results in self.in_order(plan))
        return PairResults(by_method, sources, problems, absent)


def _by_method(pairs: Iterable[Results]) -> dict[str, ByGap]:
    by_method: dict[str, dict[int, list[PairResult]]] = {}
    for results in pairs:
        for name, result in results.items():
            by_gap = by_method.setdefault(name, {})
            by_gap.setdefault(result.source - result.target, []).append(result)
    return dict(by_method)


def _key(path: Path, pair: Pair) -> str:
    return f"{path.resolve()}:{pair[0]}-{pair[1]}"
