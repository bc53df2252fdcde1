"""Measurement of one pair of frames: a function of only the pair and the method."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field

from rgbd_glue_ros.evaluation.registration_errors import RegistrationErrors, registration_errors
from rgbd_glue_ros.experiments.pairs.methods import NO_RESULT, Described, PairMethod
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import distances
from rgbd_glue_ros.stopwatch import timed
from rgbd_glue_ros.types import Correspondences, Float64, View

logger = logging.getLogger(__name__)

INLIER_THRESHOLDS_CM = (10, 5, 2.5)
"""Distances under the true transform below which a match counts as an inlier (table 4)."""


@dataclass(frozen=True)
class Inliers:
    """How many of a set of matches agree with the true transform.

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
class PairFrame:
    """A frame of a pair; the methods' descriptions of it are computed on first use, and kept.

    Attributes:
        recording: name of the recording.
        index: number of the frame in it, from 0.
        view: what the camera saw.
        T_world_camera: true pose, float64 [4, 4].
    """

    recording: str
    index: int
    view: View
    T_world_camera: Float64
    _described: dict[object, Described] = field(default_factory=dict, repr=False)

    def described(self, method: PairMethod) -> Described:
        """The description of the frame by ``method``."""
        if method.description not in self._described:
            self._described[method.description] = method.describe(self.view)
        return self._described[method.description]


@dataclass(frozen=True)
class PairResult:
    """The record of one pair; plain numbers and texts.

    Attributes:
        recording: name of the recording.
        source: number of the frame that was registered.
        target: number of the frame that it was registered to.
        errors: of the transform.
        visual: inliers of the visual matches C_vis.
        before: inliers of the geometric matches C_geo.
        after: inliers of the matches that passed the filter, C_geo^in.
        filtered: whether the filter was applied.
        epsilon_m: its threshold, metres; NaN if it was skipped.
        seconds: wall time, including both frames' features.
        stages_ms: wall time of each stage; those of the features are of both frames.
    """

    recording: str
    source: int
    target: int
    errors: RegistrationErrors
    visual: Inliers
    before: Inliers
    after: Inliers
    filtered: bool
    epsilon_m: float
    seconds: float
    stages_ms: dict[str, float]


def evaluate_pair(method: PairMethod, source: PairFrame, target: PairFrame) -> PairResult:
    """Registers two frames of a recording, source to target, and compares with ground truth.

    If a method raises an error, it has failed on the pair, which is logged.
    """
    truth = se3.inverse(target.T_world_camera) @ source.T_world_camera
    result, seconds, stages = NO_RESULT, 0.0, dict[str, float]()
    try:
        described = source.described(method), target.described(method)
        for frame in described:
            seconds += frame.seconds
            for stage, milliseconds in frame.stages_ms.items():
                stages[stage] = stages.get(stage, 0.0) + milliseconds
        result, registration_ms = timed(method.register, *described)
        seconds += registration_ms / 1e3
    except Exception as error:  # noqa: BLE001 - one pair in thousands must not end the run
        logger.warning(
            "%s, frames %d and %d: %s: %s; counted as failed",
            *(source.recording, target.index, source.index, type(error).__name__, error),
        )
    return PairResult(
        recording=source.recording,
        source=source.index,
        target=target.index,
        errors=registration_errors(result.T_target_source, truth, source.view, target.view),
        visual=Inliers.of(result.visual, truth),
        before=Inliers.of(result.geometric, truth),
        after=Inliers.of(result.credible, truth),
        filtered=result.filtered,
        epsilon_m=result.epsilon_m,
        seconds=seconds,
        stages_ms={**stages, **result.stages_ms},
    )
