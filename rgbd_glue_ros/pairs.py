"""The paper's experiments: registers frames a fixed gap apart and compares with the truth."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from rgbd_glue_ros.camera import grey, limit_depth, rectified
from rgbd_glue_ros.config import CameraConfig, Config, values
from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.pair_evaluation import PairFrame, PairResult, evaluate_pair
from rgbd_glue_ros.pair_methods import PairMethod, method_of
from rgbd_glue_ros.pairs_figures import gap_figures
from rgbd_glue_ros.pairs_report import to_markdown
from rgbd_glue_ros.sequences import Sequence as Recording
from rgbd_glue_ros.trajectory import MAX_TIME_DIFFERENCE_S
from rgbd_glue_ros.types import NANOSECONDS, Float64, RgbdFrame, Trajectory, View

logger = logging.getLogger(__name__)

FIGURES, TABLES = "pairs.json", "pairs.md"

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
        peers: registrations of others, to be measured on the same pairs.
        results: of every pair, by method and gap.
        sources: recordings that pairs were taken of.
        problems: what kept others, or a part of these, from being used.
    """

    config: Config
    gaps: Sequence[int]
    every: int | None = None
    peers: Sequence[str] = ()
    results: dict[str, dict[int, list[PairResult]]] = field(default_factory=dict)
    sources: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    def pair_count(self, frames: int) -> int:
        """How many pairs a recording of so many frames gives, at most."""
        return sum(len(range(0, frames - gap, self.stride(gap))) for gap in self.gaps)

    def stride(self, gap: int) -> int:
        """Frames from the start of one pair to that of the next."""
        return self.every or gap

    def run(
        self, recording: Recording, methods: Mapping[str, PairMethod]
    ) -> Iterator[dict[str, PairResult]]:
        """Registers the pairs of a recording, the later frame to the earlier one.

        Every frame is read once, and described once for all pairs that it is in.

        Yields:
            The results of each pair, by method; they are in ``results`` too.

        Raises:
            InputError: there is no ground truth, or a frame cannot be read; the pairs before it
                are in ``results``.
        """
        truth = recording.ground_truth
        if truth is None:
            raise InputError(
                recording.name, "has no ground truth", "give a recording that has true poses"
            )
        self.sources.append(recording.name)
        frames: dict[int, PairFrame] = {}
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
            view = _view(image, self.config.camera)
            frames[index] = PairFrame(recording.name, index, view, pose)
            for gap in ends:
                if index - gap in frames:
                    yield self._evaluated(methods, gap, frames[index], frames[index - gap])
            frames = {i: frame for i, frame in frames.items() if i > index - max(self.gaps)}
        if unposed:
            self.problems.append(
                f"{recording.name}: frames without a true pose, left out: {unposed}"
            )

    def _evaluated(
        self, methods: Mapping[str, PairMethod], gap: int, source: PairFrame, target: PairFrame
    ) -> dict[str, PairResult]:
        found = {name: evaluate_pair(m, source, target) for name, m in methods.items()}
        for name, result in found.items():
            self.results.setdefault(name, {}).setdefault(gap, []).append(result)
        return found

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
            "peers": {name: {"gaps": gaps} for name, gaps in by_method.items() if name != GLUE},
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
    on_pair: Callable[[dict[str, PairResult]], None] = lambda _: None,
) -> dict[str, Any]:
    """Runs an experiment over recordings; one that cannot be used is reported, the rest goes on.

    However it ends, the figures of the pairs done are written.

    Args:
        sources: the recordings.
        open_source: opens one.
        experiment: takes up the results.
        folder: where the results go; created if it is not there.
        on_source: called with every recording that is opened.
        on_pair: called after every pair with its results by method.

    Returns:
        The figures, as ``Experiment.figures`` gives them.

    Raises:
        InputError: the folder cannot be written, or there was no pair at all.
        MissingExtraError: a feature needs a library that is not installed.
    """
    methods = _methods(experiment)
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
                for results in experiment.run(recording, methods):
                    on_pair(results)
        except InputError as error:
            unusable.append(error)
            experiment.problems.append(str(error))

    try:
        for source in sources:
            run(source)
    finally:
        if experiment.results:
            experiment.write(folder)
            for problem in experiment.problems:
                logger.warning("%s", problem)
    if not experiment.results:
        if unusable:
            raise unusable[0]
        gap = min(experiment.gaps)
        raise InputError("--gap", f"no two frames with a true pose are {gap} apart", "give less")
    return experiment.figures()


def _methods(experiment: Experiment) -> dict[str, PairMethod]:
    """The experiment's methods, less the peers that cannot be had, which is a problem of it.

    Raises:
        MissingExtraError: the configuration's own method needs a library that is not installed.
    """
    methods = {GLUE: method_of(experiment.config)}

    def add(peer: str) -> None:
        try:
            methods[peer] = method_of(peer)
        except (InputError, MissingExtraError) as error:
            experiment.problems.append(str(error))

    for peer in experiment.peers:
        add(peer)
    return methods


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
