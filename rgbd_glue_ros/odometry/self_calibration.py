"""What the images reveal about their camera: when they are taken, and how they err."""

from __future__ import annotations

from dataclasses import replace

from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.odometry.background import BackgroundThread, BackgroundValue, Once
from rgbd_glue_ros.odometry.depth_color_check import DepthColorCheck
from rgbd_glue_ros.odometry.pose_covariance import PoseErrors
from rgbd_glue_ros.odometry.tracking import PoseFix
from rgbd_glue_ros.parameters import Config, RefineConfig
from rgbd_glue_ros.refinement.agreement import BandAgreement
from rgbd_glue_ros.refinement.pose_residuals import rows_at
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.time_offsets import TimeOffsets
from rgbd_glue_ros.types import NANOSECONDS, Float64, RgbdFrame, View

# Every second frame is checked for how well the bands of its image agree: that changes slowly.
_BANDS_COMPARED_EVERY = 2


class SelfCalibration:
    """The camera's time offsets, the errors of its poses, whether depth is registered to colour.

    The background thread updates them after a frame has its pose. The next frame is the first to
    need them, and waits for what is not ready.
    """

    def __init__(self, background: BackgroundThread, config: Config) -> None:
        self._config = config
        self._time_offsets = BackgroundValue(background, TimeOffsets.start(config.time_offsets, ""))
        self._depth_color_check = BackgroundValue(background, DepthColorCheck.start())
        self._agreement = BackgroundValue(background, BandAgreement())
        self._frames = 0

    def reconfigure(self, config: Config) -> None:
        """Sets other parameters; what was learnt remains."""
        self._config = config

    def start(self, frame_id: str) -> None:
        """Starts with what is known about the camera whose optical frame has this name."""
        self._time_offsets.replace(TimeOffsets.start(self._config.time_offsets, frame_id))

    def prepare(self, frame: RgbdFrame, twist: Float64) -> View:
        """The frame without lens distortion and depth out of range; when each image was taken.

        Args:
            frame: as the camera gave it.
            twist: float64 [6], the velocity that the camera is expected to have.
        """
        offsets = self._time_offsets.current()
        delay = frame.depth_delay_ns / NANOSECONDS - offsets.depth_latency
        view = view_of(frame, self._config.camera)
        return replace(view, twist=twist, readout_time=offsets.readout_time, depth_delay=delay)

    def refine_config(self) -> RefineConfig:
        """How poses are refined: with less weight on colour if depth is not registered to it."""
        config = self._config.refine
        if self._depth_color_check.current().placement is None:
            return config
        return replace(config, pixel_weight=min(config.pixel_weight, config.unregistered_weight))

    def pose_errors(self) -> PoseErrors:
        """The errors of this camera's poses.

        How many residuals count as one follows from how well bands of its images agree; the error
        of time, from how long an image takes to be read.
        """
        typical = PoseErrors.of(self._config)
        ratio = self._time_offsets.current().readout_ratio
        count = self._agreement.current().residuals_per_independent_one(
            typical.residuals_per_independent_one
        )
        return replace(
            typical,
            residuals_per_independent_one=count,
            timing_error=ratio * typical.timing_error,
        )

    def learnt_config(self) -> Config:
        """The configuration with all that was learnt about the camera."""
        return self.pose_errors().applied_to(replace(self._config, refine=self.refine_config()))

    def learn_from(
        self, fix: PoseFix, view: View, T_track_camera: Float64, *, twist_is_certain: bool
    ) -> None:
        """Updates what is known about the camera from a frame that has its pose.

        Args:
            fix: the pose.
            view: the frame, with its twist as estimated afterwards.
            T_track_camera: the pose after the motion filter, float64 [4, 4].
            twist_is_certain: whether ``view.twist`` holds for the moment of the frame.
        """
        pose = fix.estimate.refinement
        problem = RefinementProblem(fix.model, view, self.refine_config())
        rows, drift = Once(rows_at, pose, problem, level=0), self._config.time_offsets
        if twist_is_certain and not self._time_offsets.current().is_settled:
            self._time_offsets.update_later(
                lambda offsets: offsets.corrected(
                    rows.result(), pose.T_model_source, problem, drift
                )
            )
        self._frames += 1
        if self._frames % _BANDS_COMPARED_EVERY == 0:
            self._agreement.update_later(lambda agreement: agreement.after_frame(rows.result()))
        if self._depth_color_check.current().needs(view, T_track_camera):
            self._depth_color_check.update_later(DepthColorCheck.after_view, view, T_track_camera)
