"""The paper's experiments: registers frames a fixed gap apart and compares with the truth."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from statistics import fmean, median
from tempfile import TemporaryFile
from time import perf_counter
from typing import Any

import numpy as np

from rgbd_glue_ros import se3
from rgbd_glue_ros.camera import grey, limit_depth, rectified
from rgbd_glue_ros.config import CameraConfig, Config, values
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.estimation import distances
from rgbd_glue_ros.glue import FrameFeatures, Glue
from rgbd_glue_ros.pairs_report import to_markdown
from rgbd_glue_ros.registration_errors import (
    RegistrationErrors,
    error_statistics,
    registration_errors,
)
from rgbd_glue_ros.sequences import Sequence as Recording
from rgbd_glue_ros.trajectory import MAX_TIME_DIFFERENCE_S
from rgbd_glue_ros.types import (
    NANOSECONDS,
    Correspondences,
    Float64,
    RegistrationResult,
    RegistrationStatus,
    RgbdFrame,
    Trajectory,
    View,
)

logger = logging.getLogger(__name__)

FIGURES, TABLES = "pairs.json", "pairs.md"

INLIER_THRESHOLDS_CM = (10, 5, 2.5)
"""Distances under the true transform below which a match counts as an inlier (table 4)."""

_NO_MATCHES = Correspondences.empty()
_NOTHING = RegistrationResult(
    None,
    RegistrationStatus.TOO_FEW_CORRESPONDENCES,
    visual=_NO_MATCHES,
    visual_inliers=_NO_MATCHES,
    geometric=_NO_MATCHES,
    credible=_NO_MATCHES,
)


@dataclass(frozen=True)
class Inliers:
    """How many of a set of matches the true transform agrees with.

    Attributes:
        matches: size of the set.
        amounts: matches within each of ``INLIER_THRESHOLDS_CM``.
    """

    matches: int
    amounts: tuple[int, ...]

    @staticmethod
    def of(matches: Correspondences, truth: Float64) -> Inliers:
        """Counts the inliers of ``matches`` under the true T_target_source [4, 4]."""
        d_cm = 100 * distances(truth, matches)
        return Inliers(
            len(matches), tuple(int((d_cm <= limit).sum()) for limit in INLIER_THRESHOLDS_CM)
        )


@dataclass(frozen=True)
class PairRecord:
    """What is kept of one pair.

    Attributes:
        errors: of the transform.
        before: inliers of the geometric matches C_geo.
        after: inliers of those that the filter left, C_geo^in.
        filtered: whether the filter was applied.
        epsilon_m: its threshold, metres; NaN when it was skipped.
        visual_matches: size of C_vis.
        seconds: wall time, both frames' features included.
        stages_ms: wall time of each stage; those of the features are of both frames.
    """

    errors: RegistrationErrors
    before: Inliers
    after: Inliers
    filtered: bool
    epsilon_m: float
    visual_matches: int
    seconds: float
    stages_ms: dict[str, float]


@dataclass
class Experiment:
    """Pairs registered so far.

    Attributes:
        config: of the registration.
        gaps: frames between the two of a pair.
        every: a pair starts at every so many frames; None takes the gap itself, so that each pair
            starts where the last one ended, as in UR&R's test split.
        records: of every pair, by gap.
        sources: recordings that pairs were taken of.
        problems: what kept others, or a part of these, from being used.
    """

    config: Config
    gaps: Sequence[int]
    every: int | None = None
    records: dict[int, list[PairRecord]] = field(default_factory=dict)
    sources: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    def pair_count(self, frames: int) -> int:
        """How many pairs a recording of so many frames gives, at most."""
        return sum(len(range(0, frames - gap, self.stride(gap))) for gap in self.gaps)

    def stride(self, gap: int) -> int:
        """Frames from the start of one pair to that of the next."""
        return self.every or gap

    def run(self, recording: Recording, glue: Glue) -> Iterator[PairRecord]:
        """Registers the pairs of a recording, the later frame to the earlier one.

        Every frame is read once and described once. No refinement follows and no prior precedes
        the registration: this is the paper's method, whatever ``config.refine`` says.

        Raises:
            InputError: there is no ground truth, or a frame cannot be read; the pairs before it
                are in ``records``.
        """
        truth = recording.ground_truth
        if truth is None:
            raise InputError(
                recording.name, "has no ground truth", "give a recording that has true poses"
            )
        self.sources.append(recording.name)
        frames: dict[int, _Frame] = {}
        unposed = 0
        for index, image in enumerate(recording):
            starts = any(index % self.stride(gap) == 0 for gap in self.gaps)
            ends = [g for g in self.gaps if index >= g and (index - g) % self.stride(g) == 0]
            if not starts and not ends:
                continue
            pose = _pose_at(truth, image.stamp_ns)
            if pose is None:
                unposed += 1
                continue
            frames[index] = _Frame(glue, _view(image, self.config.camera), pose)
            for gap in ends:
                if index - gap in frames:
                    where = f"{recording.name}, frames {index - gap} and {index}"
                    record = _registered(where, glue, frames[index], frames[index - gap])
                    self.records.setdefault(gap, []).append(record)
                    yield record
            frames = {i: frame for i, frame in frames.items() if i > index - max(self.gaps)}
        if unposed:
            self.problems.append(
                f"{recording.name}: frames without a true pose, left out: {unposed}"
            )

    def figures(self) -> dict[str, Any]:
        """The content of ``pairs.json``; ratios, accuracies and recall are in percent."""
        parameters = values(self.config)
        return {
            "features": {side: parameters[f"features.{side}"] for side in ("visual", "geometric")},
            "sources": self.sources,
            "problems": self.problems,
            "every": self.every,
            "gaps": {str(gap): gap_figures(self.records[gap]) for gap in sorted(self.records)},
            "parameters": parameters,
        }

    def write(self, folder: Path) -> dict[str, Any]:
        """Writes the figures and the tables of them."""
        figures = self.figures()
        text = json.dumps(figures, indent=2, allow_nan=False)
        (folder / FIGURES).write_text(text + "\n", encoding="utf-8")
        (folder / TABLES).write_text(to_markdown(figures), encoding="utf-8")
        return figures


def run_pairs(
    sources: Iterable[Path],
    open_source: Callable[[Path], Recording],
    experiment: Experiment,
    folder: Path,
    *,
    on_source: Callable[[Recording], None] = lambda _: None,
    on_pair: Callable[[PairRecord], None] = lambda _: None,
) -> dict[str, Any]:
    """Runs an experiment over recordings; one that cannot be used is reported, the rest goes on.

    However it ends, the figures of the pairs done are written.

    Args:
        sources: the recordings.
        open_source: opens one.
        experiment: takes up the results.
        folder: where the results go; created if it is not there.
        on_source: called with every recording that is opened.
        on_pair: called after every pair.

    Returns:
        The figures, as ``Experiment.figures`` gives them.

    Raises:
        InputError: the folder cannot be written, or there was no pair at all.
        MissingExtraError: a feature needs a library that is not installed.
    """
    glue = Glue(experiment.config)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            folder, f"cannot be written ({error.strerror})", "give another folder (-o)"
        ) from error
    unusable: list[InputError] = []

    def run(source: Path) -> None:
        try:
            with open_source(source) as recording:
                on_source(recording)
                for record in experiment.run(recording, glue):
                    on_pair(record)
        except InputError as error:
            unusable.append(error)
            experiment.problems.append(str(error))

    try:
        for source in sources:
            run(source)
    finally:
        if experiment.records:
            experiment.write(folder)
            for problem in experiment.problems:
                logger.warning("%s", problem)
    if not experiment.records:
        if unusable:
            raise unusable[0]
        gap = min(experiment.gaps)
        raise InputError("--gap", f"no two frames with a true pose are {gap} apart", "give less")
    return experiment.figures()


def gap_figures(records: Sequence[PairRecord]) -> dict[str, Any]:
    """The figures of all pairs of a gap.

    Args:
        records: of one pair at least.
    """
    described = [r for r in records if r.before.matches]
    epsilons = [r.epsilon_m**2 for r in records if r.filtered]
    sides = {
        "before": [r.before for r in described],
        "after": [r.after for r in described],
    }
    stages: dict[str, list[float]] = {}
    for record in records:
        for stage, milliseconds in record.stages_ms.items():
            stages.setdefault(stage, []).append(milliseconds)
    return {
        "pairs": len(records),
        "failed": sum(r.errors.failed for r in records),
        **error_statistics([r.errors for r in records]),
        "inlier_ratio": {side: _means(sets, _ratio) for side, sets in sides.items()},
        "inlier_amount": {side: _means(sets, _amount) for side, sets in sides.items()},
        "filter_recall": 100 * fmean(r.filtered for r in records),
        "epsilon_squared_m2": fmean(epsilons) if epsilons else None,
        "visual_matches": fmean(r.visual_matches for r in records),
        "geometric_matches": fmean(r.before.matches for r in records),
        "seconds_per_pair": fmean(r.seconds for r in records),
        "stages_ms": {stage: median(times) for stage, times in stages.items()},
    }


def _means(
    sets: Sequence[Inliers], figure: Callable[[Inliers, int], float]
) -> dict[str, float | None]:
    """The mean over all sets, by threshold; None without geometric matches."""
    return {
        f"{limit:g}": fmean(figure(inliers, column) for inliers in sets) if sets else None
        for column, limit in enumerate(INLIER_THRESHOLDS_CM)
    }


def _ratio(inliers: Inliers, column: int) -> float:
    return 100 * inliers.amounts[column] / inliers.matches


def _amount(inliers: Inliers, column: int) -> float:
    return inliers.amounts[column]


class _Frame:
    """A frame of a pair, described when it is first needed."""

    def __init__(self, glue: Glue, view: View, T_world_camera: Float64) -> None:
        self._glue = glue
        self.view = view
        self.T_world_camera = T_world_camera

    @cached_property
    def described(self) -> tuple[FrameFeatures, float]:
        """The features, and the seconds that it took to find them."""
        start = perf_counter()
        features = self._glue.extract(self.view)
        return features, perf_counter() - start


def _registered(where: str, glue: Glue, source: _Frame, target: _Frame) -> PairRecord:
    truth = se3.inverse(target.T_world_camera) @ source.T_world_camera
    result, seconds, stages = _NOTHING, 0.0, dict[str, float]()
    try:
        for features, extraction_s in (source.described, target.described):
            seconds += extraction_s
            for stage, milliseconds in features.stages_ms.items():
                stages[stage] = stages.get(stage, 0.0) + milliseconds
        start = perf_counter()
        result = glue.register(source.described[0], target.described[0])
        seconds += perf_counter() - start
    except Exception as error:  # noqa: BLE001 - one pair in thousands must not end the run
        logger.warning("%s: %s: %s; counted as failed", where, type(error).__name__, error)
    return PairRecord(
        errors=registration_errors(result.T_target_source, truth, source.view, target.view),
        before=Inliers.of(result.geometric, truth),
        after=Inliers.of(result.credible, truth),
        filtered=result.filtered,
        epsilon_m=result.epsilon_m,
        visual_matches=len(result.visual),
        seconds=seconds,
        stages_ms={**stages, **result.stages_ms},
    )


def _view(frame: RgbdFrame, limits: CameraConfig) -> View:
    frame = rectified(frame)
    return View(grey(frame.color), limit_depth(frame.depth, limits), frame.intrinsics)


def _pose_at(truth: Trajectory, stamp_ns: int) -> Float64 | None:
    """The true pose nearest in time, None if none is near."""
    apart = np.abs(truth.stamps_ns - stamp_ns)
    row = int(apart.argmin())
    if apart[row] > round(MAX_TIME_DIFFERENCE_S * NANOSECONDS):
        return None
    pose: Float64 = truth.poses[row]
    return pose
