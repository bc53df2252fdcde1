"""A part of the robot in front of a recording's camera: a bumper, and a finger up to the middle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.experiments.bench.degraded import in_levels
from rgbd_glue_ros.refinement.model import Mask
from rgbd_glue_ros.types import RgbdFrame

# As near as a gripper: depth at the lower border, and its increase to the upper.
_NEAREST_M, _RECEDES_M = 0.35, 0.1
_NOISE_M = 0.001
# Fractions of the image: start of the bumper, half the finger's width, position of its tip.
_BUMPER, _FINGER, _TIP = 0.75, 0.08, 0.5
# Dull metal, grey levels.
_GREY, _SHEEN, _GREY_NOISE = 56, 6, 2


def pixels_of_part(height: int, width: int) -> Mask:
    """The pixels of the part in an image, bool [H, W]."""
    v, u = np.mgrid[:height, :width]
    finger = (np.abs(u - width / 2) < _FINGER * width) & (v > _TIP * height)
    return np.asarray((v > _BUMPER * height) | finger, np.bool_)


def with_robot_part(frame: RgbdFrame, rng: np.random.Generator) -> RgbdFrame:
    """The frame, whose colour has three channels, with the part in it."""
    height, width = frame.depth.shape
    v, u = np.mgrid[:height, :width]
    part = pixels_of_part(height, width)
    depth = _NEAREST_M + _RECEDES_M * (1 - v / height) + rng.normal(0, _NOISE_M, part.shape)
    metal = in_levels(_GREY + _SHEEN * np.sin(u / 20) + rng.normal(0, _GREY_NOISE, part.shape))
    return replace(
        frame,
        color=np.where(part[..., np.newaxis], metal[..., np.newaxis], frame.color),
        depth=np.where(part, depth, frame.depth).astype(np.float32),
    )
