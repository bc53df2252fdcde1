"""Whether planes and pixels support a pose enough to accept it."""

from __future__ import annotations

from dataclasses import replace

from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.refinement.gauss_newton import Refinement


def is_plausible(found: Refinement, asked: int, config: OdometryConfig) -> bool:
    """Whether planes or pixels support a pose and the planes do not contradict it.

    Args:
        found: the pose.
        asked: planes of which a fraction has to agree.
        config: thresholds.
    """
    enough = asked >= config.min_planes
    agreement = found.planes_agreeing / max(asked, 1)
    if enough and agreement < config.plane_agreement / 2:
        return False
    return (enough and agreement >= config.plane_agreement) or (
        found.pixels_seen >= config.min_pixels
        and found.brightness_correlation >= config.brightness_correlation
    )


def is_conclusive(found: Refinement, config: OdometryConfig) -> bool:
    """Whether to accept an unlikely pose: one that a camera can hardly reach, or was at before.

    Both planes and pixels must support it, including those that may be occluded.
    """
    return (
        found.planes_seen >= config.min_planes
        and found.plane_agreement >= config.plane_agreement
        and found.brightness_correlation >= config.brightness_correlation
    )


def sceptical(config: OdometryConfig) -> OdometryConfig:
    """Stricter thresholds for a pose that no motion leads to, as after frames without a pose.

    Of the many poses that a camera may have reached, some agree with a few planes or pixels.
    """
    return replace(
        config,
        min_planes=4 * config.min_planes,
        min_pixels=4 * config.min_pixels,
        brightness_correlation=(1 + config.brightness_correlation) / 2,
    )
