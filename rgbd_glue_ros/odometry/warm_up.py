"""Runs every stage once before the first frame, to load libraries and compile code."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from rgbd_glue_ros.closing import uninterrupted
from rgbd_glue_ros.geometry.depth import metres_of_16_bits
from rgbd_glue_ros.geometry.depth_registration import DepthCamera, registered
from rgbd_glue_ros.geometry.reduction import reduced
from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.odometry.own_parts import OwnParts
from rgbd_glue_ros.odometry.plane_counts import PlaneCounts
from rgbd_glue_ros.parameters import Config, with_values
from rgbd_glue_ros.refinement.gauss_newton import START_BRIGHTNESS
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.second_derivatives import real_and_apparent_information
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.types import NANOSECONDS, CameraIntrinsics, RgbdFrame

_WIDTH, _HEIGHT = 640, 480
_FOCAL_PX = 525.0
_PERIOD_NS = NANOSECONDS // 30


def warm_up(config: Config, glue: Glue | None = None) -> None:
    """Tracks a few synthetic frames; takes long only if no compiled code is cached.

    Args:
        config: the configuration to warm up.
        glue: of that configuration, if there is one; None creates one, which reads its weights.
    """
    # every frame becomes a keyframe, which runs further code
    config = with_values(config, {"odometry.keyframe_translation": 0.001})
    frame = _frame()
    with Odometry(config, glue) as odometry:
        for i in range(4):
            odometry.process(_moved(frame, i))
    # these frames contain no contradiction and no bare wall, too little motion to look for parts of
    # the robot, and depth that is registered
    view = view_of(frame, config.camera)
    with uninterrupted():
        problem = RefinementProblem(model_of(view, config.refine.grid_step), view, config.refine)
        PlaneCounts.of(np.eye(4), np.eye(4), problem.at_level(0))
        real_and_apparent_information(np.eye(4), problem, np.array(START_BRIGHTNESS))
        OwnParts().after_view(view, np.eye(4)).after_view(view, np.eye(4))
        reduced(frame, _WIDTH // 2)
        registered(frame.depth, DepthCamera(frame.intrinsics, np.eye(4)), frame.intrinsics)


@cache
def warm_up_once(config: Config) -> None:
    """Like ``warm_up``, for who plays several recordings: a process warms up once for each config.

    Args:
        config: the configuration to warm up.
    """
    warm_up(config)


def _frame() -> RgbdFrame:
    """A textured bumpy wall behind a box, so that every stage has work to do."""
    centre = (_WIDTH - 1) / 2, (_HEIGHT - 1) / 2
    camera = CameraIntrinsics(_WIDTH, _HEIGHT, _FOCAL_PX, _FOCAL_PX, *centre)
    blocks = np.random.default_rng(0).integers(0, 255, (_HEIGHT // 8, _WIDTH // 8, 3), np.uint8)
    color = np.kron(blocks, np.ones((8, 8, 1), np.uint8))
    u, v = np.arange(_WIDTH), np.arange(_HEIGHT)[:, None]
    millimetres = (2000 + 200 * np.sin(u / 50) * np.cos(v / 40)).astype(np.uint16)
    millimetres[_HEIGHT // 4 : -_HEIGHT // 4, _WIDTH // 4 : -_WIDTH // 4] -= 800
    return RgbdFrame(
        0, color, metres_of_16_bits(millimetres, 1000), camera, depth_delay_ns=_PERIOD_NS
    )


def _moved(frame: RgbdFrame, i: int) -> RgbdFrame:
    """What the frame shows, i periods later and to the right."""
    shift = 2 * i
    return replace(
        frame,
        stamp_ns=i * _PERIOD_NS,
        color=np.roll(frame.color, shift, axis=1),
        depth=np.roll(frame.depth, shift, axis=1),
    )
