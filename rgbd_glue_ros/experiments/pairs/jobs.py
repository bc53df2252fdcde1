"""Selects the pairs of frames of a recording, and evaluates a part of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rgbd_glue_ros.closing import uninterrupted
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.registration_errors import RegistrationErrors
from rgbd_glue_ros.experiments.batch.opening import Opener
from rgbd_glue_ros.experiments.pairs.evaluation import Inliers, PairFrame, PairResult, evaluate_pair
from rgbd_glue_ros.experiments.pairs.methods import Estimator, PairMethod, method_of
from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.parameters import CameraConfig
from rgbd_glue_ros.recordings import Recording
from rgbd_glue_ros.trajectories.association import MAX_TIME_DIFFERENCE_S
from rgbd_glue_ros.types import NANOSECONDS, Float64, RgbdFrame, Trajectory

Pair = tuple[int, int]
"""Numbers of two frames: the target, and the registered one."""

Results = dict[str, PairResult]
"""Results of one pair, by method."""


@dataclass(frozen=True)
class PairJob:
    """Pairs of one recording; everything that a process needs to evaluate them.

    Attributes:
        path: of the recording.
        open_recording: opens it.
        pairs: to evaluate, in the order in which their later frames come.
        estimators: the methods, with their names.
        camera: how depth images are used.
    """

    path: Path
    open_recording: Opener
    pairs: tuple[Pair, ...]
    estimators: tuple[tuple[str, Estimator], ...]
    camera: CameraConfig


@dataclass(frozen=True)
class Unposed:
    """A frame that should be in a pair but has no ground truth."""

    index: int


def pairs_of(frames: int, gaps: Sequence[int], every: int | None = None) -> list[Pair]:
    """The pairs of a recording, in the order in which their later frames come.

    Args:
        frames: number of frames in the recording.
        gaps: frames between the two of a pair.
        every: frames between starts of pairs; None takes the gap.
    """
    pairs = [(i, i + gap) for gap in gaps for i in range(0, frames - gap, every or gap)]
    return sorted(pairs, key=lambda pair: (pair[1], -pair[0]))


def run_job(job: PairJob) -> Iterator[Results | Unposed | InputError]:
    """The results of each pair; a fault of the recording is returned where it occurred."""
    methods = {name: method_of(estimator) for name, estimator in job.estimators}
    try:
        with job.open_recording(job.path) as recording:
            yield from evaluate_pairs(recording, job.pairs, methods, job.camera)
    except InputError as error:
        yield error


def evaluate_pairs(
    recording: Recording,
    pairs: Sequence[Pair],
    methods: Mapping[str, PairMethod],
    camera: CameraConfig,
) -> Iterator[Results | Unposed | InputError]:
    """Registers the pairs of a recording, the later frame to the earlier one.

    Every frame is read once, and described once for all its pairs. An unreadable one is in no pair,
    and the reason is returned in its place.

    Raises:
        InputError: there is no ground truth.
    """
    truth = true_poses(recording)
    targets: dict[int, list[int]] = {}
    last_use: dict[int, int] = {}
    for target, source in pairs:
        targets.setdefault(source, []).append(target)
        last_use[target] = max(source, last_use.get(target, 0))
    frames: dict[int, PairFrame] = {}
    for index, image in _read(recording, sorted({*targets, *last_use})):
        if isinstance(image, InputError):
            yield image
            continue
        pose = pose_at(truth, image.stamp_ns)
        if pose is None:
            yield Unposed(index)
            continue
        with uninterrupted():
            frames[index] = PairFrame(recording.name, index, view_of(image, camera), pose)
        for target in targets.get(index, ()):
            if target in frames:
                yield _evaluated(methods, frames[index], frames[target])
        frames = {i: frame for i, frame in frames.items() if last_use.get(i, 0) > index}


@uninterrupted()
def _evaluated(methods: Mapping[str, PairMethod], source: PairFrame, target: PairFrame) -> Results:
    return {name: evaluate_pair(method, source, target) for name, method in methods.items()}


def _read(
    recording: Recording, needed: Sequence[int]
) -> Iterator[tuple[int, RgbdFrame | InputError]]:
    """The frames with these numbers, or their errors, up to the end of the recording."""
    done, said = 0, ""
    while done < len(needed):
        try:
            for image in recording.select(needed[done:]):
                yield needed[done], image
                done += 1
        except InputError as error:  # noqa: PERF203 - a try for each fault, not for each frame
            yield needed[done], error
            # if repeated for the next frame it applies to all that follow, as in a truncated file
            if str(error) == said:
                return
            done, said = done + 1, str(error)
        else:
            return


def true_poses(recording: Recording) -> Trajectory:
    """The recording's ground truth.

    Raises:
        InputError: there is none.
    """
    truth = recording.ground_truth
    if truth is None:
        raise InputError(
            recording.name, "has no ground truth", "give a recording with ground truth"
        )
    return truth


def to_json(results: Results) -> dict[str, Any]:
    """The journal's record of a pair."""
    return {
        name: {**asdict(result), "epsilon_m": result.epsilon_m if result.filtered else None}
        for name, result in results.items()
    }


def from_json(content: Mapping[str, Any]) -> Results:
    """The results that were passed to ``to_json``, to the last bit."""
    return {name: _result(fields) for name, fields in content.items()}


def _result(fields: Mapping[str, Any]) -> PairResult:
    inliers = {
        side: Inliers(fields[side]["matches"], tuple(fields[side]["amounts"]))
        for side in ("visual", "before", "after")
    }
    epsilon_m = float("nan") if fields["epsilon_m"] is None else fields["epsilon_m"]
    errors = RegistrationErrors(**fields["errors"])
    return PairResult(**{**fields, **inliers, "errors": errors, "epsilon_m": epsilon_m})


def pose_at(truth: Trajectory, stamp_ns: int) -> Float64 | None:
    """The ground-truth pose nearest in time, None if none is near."""
    apart = np.abs(truth.stamps_ns - stamp_ns)
    row = int(apart.argmin())
    if apart[row] > round(MAX_TIME_DIFFERENCE_S * NANOSECONDS):
        return None
    pose: Float64 = truth.poses[row]
    return pose
