"""Other names of parameters, in one place: old ones, and those that users of rtabmap_odom know.

They are accepted wherever a parameter is set: in YAML, by ``--set`` and as ROS parameters.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

from rgbd_glue_ros.errors import InputError

logger = logging.getLogger(__name__)

OLD_NAMES: dict[str, str] = {
    "refine.correlation": "refine.residuals_per_independent_one",
    "timing.depth_latency": "time_offsets.depth_latency",
    "timing.readout": "time_offsets.readout_time",
    "timing.spread": "time_offsets.spread",
    "timing.drift": "time_offsets.drift",
    "timing.correlation": "time_offsets.residuals_per_independent_one",
    "odometry.pixel_correlation": "odometry.brightness_correlation",
    "odometry.recovery_attempts": "odometry.relocalisation_attempts",
    "odometry.recovery_inliers": "odometry.relocalisation_inliers",
}
"""Former names of parameters, and the current ones. Each use logs a line."""

USUAL_NAMES = {"reset_countdown": "odometry.reset_countdown"}
"""Names in rtabmap_odom, and the corresponding parameters here."""


def current_name(name: str) -> str:
    """The parameter that a name stands for; other names stay."""
    return OLD_NAMES.get(name) or USUAL_NAMES.get(name) or name


def by_current_names(changes: Mapping[str, object]) -> dict[str, object]:
    """``changes`` with every alias replaced by the parameter's name; other names stay.

    Raises:
        InputError: a parameter is given by both of its names.
    """
    current: dict[str, object] = {}
    for name, value in changes.items():
        meant = current_name(name)
        if meant in current or (meant != name and meant in changes):
            raise InputError(name, f"is another name of {meant}, which is set too", "set one")
        if name in OLD_NAMES:
            logger.warning("The parameter %s is now called %s", name, meant)
        current[meant] = value
    return current
