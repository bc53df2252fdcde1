"""The odometry on frames that are missing, dark, blank, patchy or with a passer-by."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rgbd_glue_ros.experiments.bench.contest import Ours
from rgbd_glue_ros.experiments.bench.degraded import DEGRADATIONS, DegradedSequence
from rgbd_glue_ros.experiments.bench.figures import errors, honesty, losses, trajectory_of
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.recordings import Recording
from rgbd_glue_ros.types import OdometryEstimate


class Robustness:
    """A ``Part``: the odometry over a recording with one degradation after another."""

    title = "robustness"

    def __init__(self, recording: Recording, config: Config) -> None:
        self._sequences = [DegradedSequence(recording, worse) for worse in DEGRADATIONS]
        self._truth = recording.ground_truth
        self._config = config
        self._estimates: dict[str, list[OdometryEstimate]] = {}

    @property
    def frame_count(self) -> int:
        """Frames of all degraded sequences."""
        return sum(sequence.frame_count for sequence in self._sequences)

    def run(self, step: Callable[[], None]) -> None:
        """Runs the odometry over each."""
        for sequence in self._sequences:
            with Ours(self._config) as ours:
                self._estimates[sequence.degradation.name] = ours.estimates
                for frame in sequence:
                    ours.process(frame)
                    step()

    def figures(self) -> dict[str, Any]:
        """Losses and errors by kind of degradation."""
        return {"robustness": {name: self._of(e) for name, e in self._estimates.items()}}

    def _of(self, estimates: list[OdometryEstimate]) -> dict[str, Any]:
        return {
            **losses(estimates),
            **errors(trajectory_of(estimates), self._truth),
            **honesty(estimates, self._truth),
        }
