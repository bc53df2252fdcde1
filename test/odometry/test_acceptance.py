"""What planes and pixels must say of a pose before it is believed."""

from __future__ import annotations

import numpy as np
import pytest

from rgbd_glue_ros.odometry.acceptance import is_conclusive, is_plausible, sceptical
from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.refinement.gauss_newton import START_BRIGHTNESS, Refinement

CONFIG = OdometryConfig()
MANY = 4 * CONFIG.min_planes


def found(planes: int, agreement: float, pixels: int, correlation: float) -> Refinement:
    """A refined pose of which planes and pixels say so much."""
    return Refinement(
        np.eye(4),
        np.eye(6),
        planes_seen=planes,
        planes_agreeing=round(planes * agreement),
        planes_occluded=0,
        pixels_seen=pixels,
        brightness_correlation=correlation,
        affine_brightness=np.array(START_BRIGHTNESS),
    )


def plausible(pose: Refinement, config: OdometryConfig) -> bool:
    return is_plausible(pose, pose.planes_visible, config)


@pytest.mark.parametrize(
    ("pose", "believed", "conclusive"),
    [
        (found(MANY, 0.9, MANY, 0.9), True, True),
        (found(MANY, 0.9, 0, 0.0), True, False),
        (found(0, 0.0, MANY, 0.9), True, False),
        (found(MANY, 0.1, MANY, 0.9), False, False),
        (found(MANY, 0.4, MANY, 0.9), True, False),
        (found(MANY, 0.4, MANY, 0.5), False, False),
        (found(0, 0.0, 0, 0.0), False, False),
    ],
)
def test_planes_or_pixels_support_a_pose_and_decide_together(
    pose: Refinement, believed: bool, conclusive: bool
) -> None:
    assert plausible(pose, CONFIG) is believed
    assert is_conclusive(pose, CONFIG) is conclusive


def test_after_a_gap_a_few_planes_or_pixels_are_not_enough() -> None:
    few_planes, few_pixels = found(MANY - 1, 0.9, 0, 0.0), found(0, 0.0, MANY - 1, 0.9)
    alike = found(0, 0.0, MANY, 0.7)
    for pose in few_planes, few_pixels, alike:
        assert plausible(pose, CONFIG)
        assert not plausible(pose, sceptical(CONFIG))
    for pose in found(MANY, 0.6, 0, 0.0), found(0, 0.0, MANY, 0.9):
        assert plausible(pose, sceptical(CONFIG))
