"""Whether what planes and pixels say of a pose is enough to believe it."""

from __future__ import annotations

from dataclasses import replace

from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.refinement.gauss_newton import Refinement


def is_plausible(found: Refinement, asked: int, config: OdometryConfig) -> bool:
    """Whether planes or pixels speak for a pose and the planes do not speak against it.

    Args:
        found: the pose.
        asked: planes of which a part has to agree.
        config: how much it takes.
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
    """Whether to believe a pose that is unlikely: one that a camera hardly gets to, or was at.

    Planes and pixels must speak for it, those too that something may hide.
    """
    return (
        found.planes_seen >= config.min_planes
        and found.plane_agreement >= config.plane_agreement
        and found.brightness_correlation >= config.brightness_correlation
    )


def sceptical(config: OdometryConfig) -> OdometryConfig:
    """What to ask of a pose that no motion leads to: as after frames that have none.

    Of the many poses that a camera may have got to, some agree with a few planes or pixels.
    """
    return replace(
        config,
        min_planes=4 * config.min_planes,
        min_pixels=4 * config.min_pixels,
        brightness_correlation=(1 + config.brightness_correlation) / 2,
    )
