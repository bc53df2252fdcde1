"""A frame whose pose is refined against the frame before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.geometry.camera import view_of
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.odometry.pose_refinement import Basin, PoseProblem
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.types import Float64, RgbdFrame


def problem_of(
    before: RgbdFrame, now: RgbdFrame, T_predicted: Float64, config: Config
) -> PoseProblem:
    """The frame before is the origin of the track frame."""
    predicted = Motion.start(before.stamp_ns, np.eye(4)).predicted(now.stamp_ns, config.motion)
    return PoseProblem(
        model_of(view_of(before, config.camera), config.refine.grid_step),
        view_of(now, config.camera),
        config.refine,
        predicted=replace(predicted, T_track_camera=T_predicted),
        basin=Basin.of(config.odometry),
    )
