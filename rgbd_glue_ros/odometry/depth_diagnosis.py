"""How much of a depth image is usable, and messages about what is wrong with it."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import without_numbers
from rgbd_glue_ros.parameters import CameraConfig
from rgbd_glue_ros.types import DepthSummary, Float32, OdometryEstimate, TrackingState

logger = logging.getLogger(__name__)

NO_POSE_YET = "No pose yet"
"""What a reason for the lack of a first pose follows in a log."""

# One pixel in this many rows and columns is sampled: shares to within a percent.
_STEP = 4
# With less than this share of the pixels, the image itself is the reason for a missing pose.
_USABLE_SHARE = 0.03
# No room is nearer as a whole: it seems so if millimetres are taken for 1/5000 m.
_DOUBTFUL_NEAR_M = 0.3
# No room is farther away as a whole: it seems so if 1/5000 m is taken for millimetres.
_DOUBTFUL_FAR_M = 5.0
# In any room, something is farther away than this: the percentile below, not a single pixel.
_DOUBTFUL_WITHIN_M = 1.0
_FAR_PERCENTILE = 95
# The least and the largest median depth of a room whose millimetres are taken for metres.
_MILLIMETRES = (300.0, 8000.0)

_SET_SCALE = (
    "depth_scale (node: -p depth_scale:=M, commands: --depth-scale M) to the metres per unit: "
    "0.001 for millimetres, 0.0002 for 5000 per metre, 0.0001 for tenths of a millimetre"
)


def summarise_depth(depth: Float32, limits: CameraConfig) -> DepthSummary:
    """Fractions of known and usable depth, and the median.

    Args:
        depth: float32 [H, W], metres, NaN or 0 where unknown.
        limits: the usable range of depth.
    """
    known = _some_known(depth)
    count = max(depth[::_STEP, ::_STEP].size, 1)
    in_range = (known >= limits.depth_min) & (known <= limits.depth_max)
    return DepthSummary(
        known=len(known) / count,
        in_range=int(in_range.sum()) / count,
        median_m=float(np.median(known)) if len(known) else float("nan"),
    )


def explain_no_pose(estimate: OdometryEstimate, limits: CameraConfig, topic: str = "") -> str:
    """Why a frame has no pose and, if known, what to do; "" if it has one.

    Args:
        estimate: of the frame.
        limits: the usable range of depth.
        topic: of depth; "" if there is none.
    """
    depth = estimate.depth
    if depth is None:
        return ""
    if depth.in_range >= _USABLE_SHARE:
        result = estimate.registration
        return "too little is visible to start" if result is None else result.status.value
    of_topic = f" {topic}" if topic else ""
    if depth.known < _USABLE_SHARE:
        return (
            f"{depth.known:.0%} of the pixels have a depth: check that the topic{of_topic} is that "
            "of the depth images, and that the camera views something within its range"
        )
    seen = (
        f"{depth.known:.0%} of the pixels have a depth, but {depth.in_range:.0%} one "
        f"from {limits.depth_min:g} to {limits.depth_max:g} m (camera.depth_min, "
        f"camera.depth_max); the median{' on' if topic else ''}{of_topic} is {depth.median_m:.3g} m"
    )
    if _are_millimetres(depth.median_m):
        return (
            f"{seen}, so these are millimetres: set depth_scale to 0.001 (commands: --depth-scale "
            "0.001, node: -p depth_scale:=0.001, Python: divide depth by 1000)"
        )
    return f"{seen}: if the unit is another, set {_SET_SCALE}"


class StartWarning:
    """Logs why there is no first pose: each cause once, however many frames have it."""

    def __init__(self) -> None:
        """Begins before the first frame."""
        self._logged: set[str] = set()

    def take(self, estimate: OdometryEstimate, limits: CameraConfig) -> None:
        """Takes the estimate of a frame, and the usable range of depth."""
        if estimate.state is not TrackingState.INITIALIZING:
            return
        why = explain_no_pose(estimate, limits)
        cause = without_numbers(why)
        if cause not in self._logged:
            self._logged.add(cause)
            logger.warning("%s: %s", NO_POSE_YET, why)


def doubt_at_start(depth: Float32) -> str | None:
    """Why the unit of depth may not be the assumed one; None if nothing suggests that.

    None for millimetres too, which ``explain_no_pose`` will tell.

    Args:
        depth: float32 [H, W], metres, NaN or 0 where unknown.
    """
    known = _some_known(depth)
    if not len(known):
        return None
    median, far = np.percentile(known, [50, _FAR_PERCENTILE])
    if _are_millimetres(median):
        return None
    if _DOUBTFUL_NEAR_M <= median <= _DOUBTFUL_FAR_M and far >= _DOUBTFUL_WITHIN_M:
        return None
    return (
        f"the median depth is {median:.3g} m, and {_FAR_PERCENTILE} % of it is within {far:.3g} "
        f"m; if that is not so, the unit is another one: set {_SET_SCALE}"
    )


def _some_known(depth: Float32) -> Float32:
    values = depth[::_STEP, ::_STEP]
    return values[np.isfinite(values) & (values > 0)]


def _are_millimetres(median: float | np.floating[Any]) -> bool:
    return bool(_MILLIMETRES[0] <= median <= _MILLIMETRES[1])
