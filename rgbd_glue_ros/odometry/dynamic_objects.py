"""Moving objects in a frame: surfaces where keyframes saw free space.

A keyframe that shows a person would pull along frames that see them elsewhere. So the depth of
whatever has come between the camera and a surface seen before is removed from a frame before it
becomes a keyframe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rgbd_glue_ros.odometry.surfaces import BLOCK_PX, Surfaces, dense, pixels_of, widened
from rgbd_glue_ros.types import Float64, View

# If more than this fraction of a frame seems to have moved, the pose is wrong instead.
_MOST = 0.7


def without_dynamic_objects(
    view: View, T_track_camera: Float64, others: Sequence[tuple[View, Float64]]
) -> View | None:
    """The view without the depth of moving objects.

    Args:
        view: a frame.
        T_track_camera: its pose, float64 [4, 4].
        others: frames that saw the same room before, each with its T_track_camera.

    Returns:
        None if nothing moves, or almost everything seems to.
    """
    if min(size for v in (view, *(o for o, _ in others)) for size in v.depth.shape) < BLOCK_PX:
        return None  # nothing to compare with
    surfaces = Surfaces.seen(view, T_track_camera)
    blocks = np.zeros(surfaces.depth.shape, np.uint8)
    for other, T_track_other in others:
        blocks |= surfaces.in_front_of(Surfaces.seen(other, T_track_other))
    moving = widened(dense(blocks))
    if not 0 < moving.mean() < _MOST:
        return None
    unknown = np.float32(np.nan)
    return replace(view, depth=np.where(pixels_of(moving, view), unknown, view.depth))
