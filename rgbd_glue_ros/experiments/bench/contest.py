"""Compares this odometry and its peers on the same frames in the same run, taking turns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter, process_time
from typing import Any, Protocol

import numpy as np

from rgbd_glue_ros.closing import Closing, uninterrupted
from rgbd_glue_ros.experiments.bench.figures import errors, honesty, losses, times
from rgbd_glue_ros.experiments.peers import NoTransformError, Peer
from rgbd_glue_ros.experiments.replay.run_record import stage_medians
from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import CameraConfig, Config
from rgbd_glue_ros.recordings import Recording
from rgbd_glue_ros.trajectories.path import trajectory_of
from rgbd_glue_ros.types import Float64, OdometryEstimate, RgbdFrame, Trajectory

OURS = "rgbd_glue_ros"

# The first frames of every contestant load and compile; their times do not count.
_UNTIMED = 3


class Contestant(Protocol):
    """A method that turns frames into poses."""

    def process(self, frame: RgbdFrame) -> Float64 | None:
        """The pose [4, 4] of the next frame in the axes of the first one; None when lost."""


class Ours(Closing):
    """The odometry of this package.

    Attributes:
        estimates: of every frame, without their correspondences.
    """

    def __init__(self, config: Config) -> None:
        self._odometry = Odometry(config)
        self.estimates: list[OdometryEstimate] = []

    def process(self, frame: RgbdFrame) -> Float64 | None:
        """The result of the odometry."""
        estimate = self._odometry.process(frame)
        self.estimates.append(replace(estimate, registration=None))
        return estimate.T_odom_camera

    def close(self) -> None:
        """Ends its background thread."""
        self._odometry.close()


class FrameToFrame:
    """Odometry by a peer that registers every frame to the last one with a pose.

    There is no keyframe, no motion model and no prior: only the peer itself.
    """

    def __init__(self, peer: Peer, limits: CameraConfig) -> None:
        self._peer = peer
        self._limits = limits
        self._last: Any = None
        self._pose: Float64 = np.eye(4)

    def process(self, frame: RgbdFrame) -> Float64 | None:
        """The pose of the last frame that has one, moved by the peer's result."""
        try:
            prepared = self._peer.prepare(view_of(frame, self._limits))
            if self._last is not None:
                self._pose = self._pose @ self._peer.register(prepared, self._last)
        except NoTransformError:
            return None
        self._last = prepared
        return self._pose


@dataclass
class _Score:
    """The results of one contestant so far."""

    contestant: Contestant
    stamps_ns: list[int] = field(default_factory=list)
    poses: list[Float64] = field(default_factory=list)
    wall_ms: list[float] = field(default_factory=list)
    cpu_ms: list[float] = field(default_factory=list)

    @uninterrupted()
    def process(self, frame: RgbdFrame) -> None:
        wall, cpu = perf_counter(), process_time()
        T = self.contestant.process(frame)
        self.cpu_ms.append(1e3 * (process_time() - cpu))
        self.wall_ms.append(1e3 * (perf_counter() - wall))
        if T is not None:
            self.stamps_ns.append(frame.stamp_ns)
            self.poses.append(T)

    @property
    def spent_s(self) -> float:
        return sum(self.wall_ms) / 1e3

    def figures(self, truth: Trajectory | None) -> dict[str, Any]:
        trajectory = trajectory_of(zip(self.stamps_ns, self.poses, strict=True))
        content: dict[str, Any] = {
            "frames": len(self.wall_ms),
            "lost": len(self.wall_ms) - len(self.poses),
        }
        if len(self.wall_ms) > _UNTIMED:
            content["wall_ms"] = times(self.wall_ms[_UNTIMED:])
            content["cpu_ms"] = times(self.cpu_ms[_UNTIMED:])
        return {**content, **errors(trajectory, truth)}


class Contest:
    """A ``Part``: speed and error of every contestant.

    All contestants process each frame before any gets the next, starting with a different one each
    time, so that other load on the machine affects all alike.
    """

    title = "speed and error"

    def __init__(
        self,
        recording: Recording,
        config: Config,
        peers: dict[str, Peer],
        patience_s: float,
        on_frame: Callable[[RgbdFrame], None],
    ) -> None:
        """Prepares the contest.

        Args:
            recording: the frames.
            config: of this package's odometry.
            peers: by name.
            patience_s: time that a peer has for the recording; one that needs more is measured on
                the frames that it completed.
            on_frame: called with every frame after all contestants, for simultaneous measurements.
        """
        self._recording = recording
        self._ours = Ours(config)
        self._scores = {OURS: _Score(self._ours)} | {
            name: _Score(FrameToFrame(peer, config.camera)) for name, peer in peers.items()
        }
        self._patience_s = patience_s
        self._on_frame = on_frame

    @property
    def frame_count(self) -> int:
        """Frames of the recording."""
        return self._recording.frame_count

    def run(self, step: Callable[[], None]) -> None:
        """Runs all contestants over the recording."""
        try:
            self._run(step)
        finally:
            self._ours.close()

    def _run(self, step: Callable[[], None]) -> None:
        for i, frame in enumerate(self._recording):
            scores = [
                score
                for who, score in self._scores.items()
                if who == OURS or score.spent_s < self._patience_s
            ]
            turn = i % len(scores)
            for score in (*scores[turn:], *scores[:turn]):
                score.process(frame)
            self._on_frame(frame)
            step()

    def figures(self) -> dict[str, Any]:
        """Times and errors of all; stages and consistency of this package's odometry."""
        truth = self._recording.ground_truth
        estimates = self._ours.estimates
        return {
            "contest": {name: score.figures(truth) for name, score in self._scores.items()},
            "tracking": losses(estimates),
            "stages_ms": stage_medians(e.stages_ms for e in estimates[_UNTIMED:]),
            **honesty(estimates, truth),
        }
