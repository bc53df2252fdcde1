"""What the images reveal about their camera, and how a frame is prepared accordingly."""

from __future__ import annotations

from dataclasses import replace

from rgbd_glue_ros.geometry.camera import view_of
from rgbd_glue_ros.odometry.background import BackgroundThread, BackgroundValue
from rgbd_glue_ros.odometry.depth_color_check import DepthColorCheck
from rgbd_glue_ros.odometry.own_parts import OwnParts
from rgbd_glue_ros.odometry.pose_covariance import PoseErrors
from rgbd_glue_ros.odometry.tracking import PoseFix
from rgbd_glue_ros.parameters import Config, RefineConfig
from rgbd_glue_ros.refinement.agreement import BandAgreement
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.time_offsets import TimeOffsets
from rgbd_glue_ros.types import NANOSECONDS, Float64, RgbdFrame, View

# Frames between checks of how well the parts of an image agree: it changes slowly.
_COMPARED_EVERY = 2


class SelfCalibration:
    """The camera's time offsets, parts of the robot in view, whether depth is registered to colour.

    The background thread updates them after a frame has its pose. The next frame is the first to
    need them, and waits in ``prepare`` if they are not ready.
    """

    def __init__(self, background: BackgroundThread, config: Config) -> None:
        self._config = config
        self._time_offsets = BackgroundValue(background, TimeOffsets.start(config.time_offsets, ""))
        self._depth_color_check = BackgroundValue(background, DepthColorCheck.start())
        self._agreement = BackgroundValue(background, BandAgreement())
        self._own_parts = BackgroundValue(background, OwnParts())
        self._as_given: View | None = None
        self._frames = 0

    def reconfigure(self, config: Config) -> None:
        """Sets other parameters; what was learnt remains, unless it is no longer enabled."""
        self._config = config
        if not config.odometry.own_parts:
            self._own_parts.replace(OwnParts())

    def start(self, frame_id: str) -> None:
        """Starts with what is known about the camera whose optical frame has this name."""
        self._time_offsets.replace(TimeOffsets.start(self._config.time_offsets, frame_id))

    def start_anew(self) -> None:
        """Continues with poses that cannot be compared with earlier ones."""
        self._own_parts.replace(self._own_parts.current().without_views())

    def prepare(self, frame: RgbdFrame, twist: Float64) -> View:
        """The frame prepared for registration, and when each image was taken.

        It has no lens distortion, no depth out of range and no parts of the robot.

        Args:
            frame: as the camera gave it.
            twist: float64 [6], the velocity that the camera is expected to have.
        """
        offsets = self._time_offsets.current()
        delay = frame.depth_delay_ns / NANOSECONDS - offsets.depth_latency
        self._as_given = view_of(frame, self._config.camera)
        view = self._own_parts.current().left_out(self._as_given)
        return replace(view, twist=twist, readout_time=offsets.readout_time, depth_delay=delay)

    def refine_config(self) -> RefineConfig:
        """How poses are refined: with less weight on colour if depth is not registered to it."""
        config = self._config.refine
        if self._depth_color_check.current().offset_px is None:
            return config
        return replace(config, pixel_weight=min(config.pixel_weight, config.unregistered_weight))

    def pose_errors(self) -> PoseErrors:
        """The errors of this camera's poses.

        How many residuals count as one follows from how well parts of its images agree; the error
        of time, from how long an image takes to be read.
        """
        typical = PoseErrors.of(self._config)
        share = self._time_offsets.current().readout_share
        count = self._agreement.current().residuals_per_independent_one(
            typical.residuals_per_independent_one
        )
        return replace(
            typical,
            residuals_per_independent_one=count,
            timing_error=share * typical.timing_error,
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
        if twist_is_certain and not self._time_offsets.current().settled:
            self._time_offsets.update_later(
                TimeOffsets.corrected, pose, problem, self._config.time_offsets
            )
        self._frames += 1
        if self._frames % _COMPARED_EVERY == 0:
            self._agreement.update_later(BandAgreement.after_frame, pose, problem)
        if self._depth_color_check.current().needs(view, T_track_camera):
            self._depth_color_check.update_later(DepthColorCheck.after_view, view, T_track_camera)
        if self._config.odometry.own_parts:
            self._look_for_own_parts(fix, view, T_track_camera)

    def _look_for_own_parts(self, fix: PoseFix, view: View, T_track_camera: Float64) -> None:
        """Compares the frame, including own parts, with earlier ones."""
        if fix.T_shift is not None:
            self.start_anew()
        if self._as_given is None or not self._own_parts.current().needs(view, T_track_camera):
            return
        seen = replace(self._as_given, twist=view.twist, depth_delay=view.depth_delay)
        self._own_parts.update_later(OwnParts.after_view, seen, T_track_camera)
