"""Images whose pose is refined against those before, which are the origin of the track frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.odometry.pose_refinement import Basin, PoseProblem
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.refinement.problem import NO_MATCHES
from rgbd_glue_ros.types import NANOSECONDS, Correspondences, Float64, RgbdFrame, View

_DEFAULT = Config()


def problem_at_rest(
    before: View,
    now: View,
    matches: Correspondences = NO_MATCHES,
    *,
    config: Config = _DEFAULT,
    interval_ns: int = NANOSECONDS // 30,
) -> PoseProblem:
    """The camera was at rest, so it is expected where it was."""
    return PoseProblem(
        model_of(before, config.refine.grid_step),
        now,
        config.refine,
        matches,
        predicted=Motion.start(0, np.eye(4)).predicted(interval_ns, config.motion),
        basin=Basin.of(config.odometry),
    )


def problem_of(
    before: RgbdFrame, now: RgbdFrame, T_predicted: Float64, config: Config
) -> PoseProblem:
    """The camera is expected at the given pose."""
    problem = problem_at_rest(
        view_of(before, config.camera),
        view_of(now, config.camera),
        config=config,
        interval_ns=now.stamp_ns - before.stamp_ns,
    )
    return replace(problem, predicted=replace(problem.predicted, T_track_camera=T_predicted))
