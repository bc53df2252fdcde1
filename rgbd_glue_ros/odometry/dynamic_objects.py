"""What moves in a frame: surfaces where keyframes saw that nothing was.

Frames that see a person elsewhere would be pulled along by a keyframe that shows them. So the depth
of whatever has come between the camera and a surface seen before is taken out of a frame before it
becomes a keyframe.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.depth import surface_tolerance
from rgbd_glue_ros.refinement.sampling import NEAREST_M
from rgbd_glue_ros.types import Float32, Float64, UInt8, View

# Surfaces are compared cell by cell, so that an error of the pose of as many pixels does no harm.
_CELL_PX = 8
# One pixel of each block is looked at for all of it.
_BLOCK_PX = 8
# A block is moving if most of those around it are; then so are those next to it, whose depth mixes
# both surfaces.
_AROUND = 3
# When more than this part of a frame seems to have moved, it is the pose that is wrong.
_MOST = 0.7


def without_dynamic_objects(
    view: View, T_track_camera: Float64, others: Sequence[tuple[View, Float64]]
) -> View | None:
    """The view without the depth of what moves.

    Args:
        view: a frame.
        T_track_camera: its pose, float64 [4, 4].
        others: frames that saw the same room before, each with its T_track_camera.

    Returns:
        None where nothing moves, or almost everything seems to.
    """
    if min(size for v in (view, *(o for o, _ in others)) for size in v.depth.shape) < _CELL_PX:
        return None  # nothing to tell by
    T_track_depth = _when_depth_was_taken(view, T_track_camera)
    K = view.intrinsics.focal_and_centre
    blocks = np.zeros([size // _BLOCK_PX for size in view.depth.shape], np.uint8)
    for other, T_track_other in others:
        T_other_depth = se3.inverse(_when_depth_was_taken(other, T_track_other)) @ T_track_depth
        K_other = other.intrinsics.focal_and_centre
        nearest = _nearest_surfaces(other.depth)
        _mark_in_front(blocks, view.depth, K, T_other_depth, nearest, K_other)
    around = cv2.boxFilter(blocks, -1, (_AROUND, _AROUND), normalize=False)
    dense = np.asarray(blocks & (around > _AROUND**2 // 2), np.uint8)
    moving = cv2.dilate(dense, np.ones((_AROUND, _AROUND), np.uint8))
    if not 0 < moving.mean() < _MOST:
        return None
    height, width = view.depth.shape
    pixels = cv2.resize(moving, (width, height), interpolation=cv2.INTER_NEAREST)
    return replace(view, depth=np.where(pixels > 0, np.float32(np.nan), view.depth))


def _when_depth_was_taken(view: View, T_track_camera: Float64) -> Float64:
    """The pose of the camera when its depth image was taken, float64 [4, 4]."""
    return T_track_camera @ se3.exp(view.twist * view.depth_delay)


def _nearest_surfaces(depth: Float32) -> Float32:
    """Least depth in each cell and those around it, float32 [H / cell, W / cell].

    NaN in a cell that knows none.
    """
    cells = _least_of_cells(depth)
    around = cv2.erode(cells, np.ones((3, 3), np.uint8))
    return np.asarray(np.where(np.isinf(cells), np.nan, around), np.float32)


@compiled
def _least_of_cells(depth: Float32) -> Float32:
    """Least depth in each cell, of every second pixel, float32 [H / cell, W / cell].

    Infinite where none is known.
    """
    rows, columns = depth.shape[0] // _CELL_PX, depth.shape[1] // _CELL_PX
    cells = np.full((rows, columns), np.float32(np.inf))
    for v in range(0, rows * _CELL_PX, 2):
        for u in range(0, columns * _CELL_PX, 2):
            # the comparison with NaN is false, where a call of min would take it
            if depth[v, u] < cells[v // _CELL_PX, u // _CELL_PX]:  # noqa: PLR1730
                cells[v // _CELL_PX, u // _CELL_PX] = depth[v, u]
    return cells


@compiled
def _mark_in_front(
    blocks: UInt8,
    depth: Float32,
    K: Float64,
    T_other_depth: Float64,
    nearest: Float32,
    K_other: Float64,
) -> None:
    """Marks the blocks of a depth image that lie in front of all that another saw there.

    Args:
        blocks: uint8 [H / block, W / block], set to 1.
        depth: float32 [H, W].
        K: of ``depth``: fx, fy, cx, cy.
        T_other_depth: from this camera to the other, float64 [4, 4].
        nearest: ``_nearest_surfaces`` of the other.
        K_other: of the other.
    """
    T = T_other_depth
    for r in range(blocks.shape[0]):
        v = r * _BLOCK_PX + _BLOCK_PX // 2
        for c in range(blocks.shape[1]):
            u = c * _BLOCK_PX + _BLOCK_PX // 2
            z = depth[v, u]
            x, y = (u - K[2]) / K[0] * z, (v - K[3]) / K[1] * z
            there = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            # with NaN this is false, too
            if not there > NEAREST_M:
                continue
            right = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
            down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
            row = math.floor((K_other[1] * down / there + K_other[3]) / _CELL_PX)
            column = math.floor((K_other[0] * right / there + K_other[2]) / _CELL_PX)
            if 0 <= row < nearest.shape[0] and 0 <= column < nearest.shape[1]:
                seen = nearest[row, column]
                if there < seen - surface_tolerance(seen):
                    blocks[r, c] = 1
