"""Moving objects in a frame: surfaces where keyframes saw free space.

A keyframe that shows a person would pull along frames that see them elsewhere. So the depth of
whatever has come between the camera and a surface seen before is removed from a frame before it
becomes a keyframe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rgbd_glue_ros.odometry.surfaces import Surfaces, dense, pixels_of, widened
from rgbd_glue_ros.types import Float64, View

# If more than this fraction of a frame seems to have moved, the pose is wrong instead.
_MOST = 0.7


def without_dynamic_objects(
    view: View, T_track_camera: Float64, others: Sequence[Surfaces]
) -> View | None:
    """The view without the depth of moving objects.

    Args:
        view: a frame.
        T_track_camera: its pose, float64 [4, 4].
        others: what was seen of the same room before, in the same track frame.

    Returns:
        None if nothing moves, or almost everything seems to.
    """
    surfaces = Surfaces.seen(view, T_track_camera)
    if surfaces.depth.size == 0:
        return None  # nothing to compare
    blocks = np.zeros(surfaces.depth.shape, np.uint8)
    for other in others:
        blocks |= surfaces.in_front_of(other)
    moving = widened(dense(blocks))
    if not 0 < moving.mean() < _MOST:
        return None
    unknown = np.float32(np.nan)
    return replace(view, depth=np.where(pixels_of(moving, view), unknown, view.depth))
