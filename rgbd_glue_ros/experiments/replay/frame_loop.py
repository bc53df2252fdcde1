"""One frame after the other through the odometry, and what is left of each."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from time import perf_counter

from rgbd_glue_ros.closing import uninterrupted
from rgbd_glue_ros.experiments.replay.run_record import Run
from rgbd_glue_ros.experiments.replay.sinks import FrameSink
from rgbd_glue_ros.odometry.depth_diagnosis import doubt_at_start
from rgbd_glue_ros.odometry.odometry import Odometry, completed
from rgbd_glue_ros.trajectories.tum import TumWriter
from rgbd_glue_ros.types import (
    ImuCalibration,
    ImuSamples,
    ImuUse,
    OdometryEstimate,
    RgbdFrame,
    TrackingState,
)

logger = logging.getLogger(__name__)


class FrameLoop:
    """Takes the frames of a recording in turn, as the node does.

    A frame with the stamp of the one before is left out and counted. Where time goes back, as in a
    bag of a recording in a loop, the odometry starts anew.

    Attributes:
        last: what is known after the last frame; None before the first.
    """

    def __init__(
        self,
        run: Run,
        odometry: Odometry,
        imu: ImuSamples,
        trajectory: TumWriter,
        sinks: Sequence[FrameSink],
        on_frame: Callable[[OdometryEstimate], None],
    ) -> None:
        """Begins.

        Args:
            run: where each frame is recorded.
            odometry: gives them poses.
            imu: all samples of the recording.
            trajectory: takes the poses as soon as they are known.
            sinks: take each frame and its estimate.
            on_frame: called after each frame.
        """
        self._run = run
        self._odometry = odometry
        self._imu = imu
        self._trajectory = trajectory
        self._sinks = sinks
        self._on_frame = on_frame
        self._start_s = perf_counter()
        self.last: OdometryEstimate | None = None
        odometry.add_imu(imu)

    @uninterrupted()
    def take(self, frame: RgbdFrame) -> None:
        """Takes a frame; an interrupt leaves no half of one, neither in code nor in results.

        Raises:
            InputError: a result cannot be written.
        """
        run, odometry = self._run, self._odometry
        if self.last is None:
            self._warn_of_scale(frame)
        elif frame.stamp_ns == self.last.stamp_ns:
            run.duplicates += 1
            return
        elif frame.stamp_ns < self.last.stamp_ns:
            self._start_anew()
        starts = odometry.state is TrackingState.INITIALIZING
        before = perf_counter()
        # not by ``process``: the replay itself says why nothing was tracked
        estimate = completed(odometry.track(frame), odometry)
        now = perf_counter()
        run.add(estimate, 1000 * (now - before))
        run.wall_s = now - self._start_s
        run.imu = _learnt(odometry)
        if estimate.T_odom_camera is not None:
            run.up = odometry.up(estimate.stamp_ns) if starts else run.up
            self._trajectory.append(estimate.stamp_ns, estimate.T_odom_camera)
        for sink in self._sinks:
            sink.add(frame, estimate)
        self._on_frame(estimate)
        self.last = estimate

    def _start_anew(self) -> None:
        self._odometry.reset()
        self._odometry.add_imu(self._imu)
        self._run.start_anew()
        for sink in self._sinks:
            sink.start_anew()

    def _warn_of_scale(self, frame: RgbdFrame) -> None:
        doubt = doubt_at_start(frame.depth)
        if doubt is not None:
            logger.warning("%s: %s", self._run.sequence, doubt)


def _learnt(odometry: Odometry) -> ImuCalibration | None:
    imu = odometry.imu_calibration
    return None if imu.use is ImuUse.NONE else imu
