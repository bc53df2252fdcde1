"""What the images tell of the camera that took them, and how a frame is prepared by it."""

from __future__ import annotations

from dataclasses import replace

from rgbd_glue_ros.geometry.camera import view_of
from rgbd_glue_ros.odometry.background import BackgroundThread, BackgroundValue
from rgbd_glue_ros.odometry.depth_color_check import DepthColorCheck
from rgbd_glue_ros.odometry.tracking import PoseFix
from rgbd_glue_ros.parameters import Config, RefineConfig
from rgbd_glue_ros.refinement.agreement import BandAgreement
from rgbd_glue_ros.refinement.time_offsets import TimeOffsets
from rgbd_glue_ros.types import NANOSECONDS, Float64, RgbdFrame, View

# Every so many frames it is seen how far the parts of an image agree: it changes slowly.
_COMPARED_EVERY = 2


class SelfCalibration:
    """The camera's time offsets, and whether its depth is registered to colour.

    The background thread updates both after a frame has its pose. The next frame is the first to
    need them, and waits in ``prepare`` if they are not there yet.
    """

    def __init__(self, background: BackgroundThread, config: Config) -> None:
        self._config = config
        self._time_offsets = BackgroundValue(background, TimeOffsets.start(config.time_offsets, ""))
        self._depth_color_check = BackgroundValue(background, DepthColorCheck.start())
        self._agreement = BackgroundValue(background, BandAgreement())
        self._frames = 0

    def reconfigure(self, config: Config) -> None:
        """Takes other parameters; what was learnt stays."""
        self._config = config

    def start(self, frame_id: str) -> None:
        """Begins with what is known of the camera whose optical frame has this name."""
        self._time_offsets.replace(TimeOffsets.start(self._config.time_offsets, frame_id))

    def prepare(self, frame: RgbdFrame, twist: Float64) -> View:
        """The frame without lens distortion, its depth in range, and when each image was taken.

        Args:
            frame: as the camera gave it.
            twist: float64 [6], the velocity that the camera is expected to have.
        """
        offsets = self._time_offsets.current()
        delay = frame.depth_delay_ns / NANOSECONDS - offsets.depth_latency
        view = view_of(frame, self._config.camera)
        return replace(view, twist=twist, readout_time=offsets.readout_time, depth_delay=delay)

    def refine_config(self) -> RefineConfig:
        """How poses are refined: with less weight on colour where depth is not registered to it."""
        config = self._config.refine
        if self._depth_color_check.current().offset_px is None:
            return config
        return replace(config, pixel_weight=min(config.pixel_weight, config.unregistered_weight))

    def learnt_config(self) -> Config:
        """The parameters as this camera has shown them to be, for covariances.

        The motion filter smooths by what is common to cameras; a covariance is of this one.

        How many residuals count as one follows from how far parts of its images agree; the error of
        time, from how long an image takes to be read.
        """
        odometry = self._config.odometry
        share = self._time_offsets.current().readout_share
        return replace(
            self._config,
            refine=self._agreement.current().applied_to(self.refine_config()),
            odometry=replace(odometry, timing_error=share * odometry.timing_error),
        )

    def learn_from(
        self, fix: PoseFix, view: View, T_track_camera: Float64, *, twist_is_certain: bool
    ) -> None:
        """Updates what is known of the camera by a frame that has its pose.

        Args:
            fix: the pose.
            view: the frame, with the twist that it turned out to have.
            T_track_camera: the pose after the motion filter, float64 [4, 4].
            twist_is_certain: whether ``view.twist`` holds for the moment of the frame.
        """
        if twist_is_certain and not self._time_offsets.current().settled:
            self._time_offsets.update_later(
                TimeOffsets.corrected,
                fix.estimate.refinement,
                fix.model,
                view,
                self.refine_config(),
                self._config.time_offsets,
            )
        self._frames += 1
        if self._frames % _COMPARED_EVERY == 0:
            self._agreement.update_later(
                BandAgreement.after_frame,
                fix.estimate.refinement,
                fix.model,
                view,
                self.refine_config(),
            )
        if self._depth_color_check.current().needs(view, T_track_camera):
            self._depth_color_check.update_later(DepthColorCheck.after_view, view, T_track_camera)
