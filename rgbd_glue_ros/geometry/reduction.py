"""Reduces the images of a large frame, and its intrinsics with them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.types import Float32, Int64, RgbdFrame

# Depth samples in a block that differ by less than this fraction are of one surface.
_SAME_SURFACE = 0.02


def reduced(frame: RgbdFrame, max_width: int) -> RgbdFrame:
    """A frame whose images have at most a given width, but at least one row.

    Every block of n x n pixels becomes one, with the smallest n that suffices. Colour is the mean
    of the block. Depth is the mean of one surface in it, that of the valid sample nearest to the
    block's centre, so that no depth lies between two surfaces.

    Args:
        frame: the frame.
        max_width: width of the images, pixels; 0 leaves them as they are.
    """
    width = frame.intrinsics.width
    if not 0 < max_width < width:
        return frame
    side = min(width // (max_width + 1) + 1, frame.intrinsics.height)
    columns, rows = width // side, frame.intrinsics.height // side
    # the remainder at the right and the bottom is less than a block
    part = slice(0, rows * side), slice(0, columns * side)
    color = cv2.resize(frame.color[part], (columns, rows), interpolation=cv2.INTER_AREA)
    whole = replace(frame.intrinsics, width=columns * side, height=rows * side)
    return replace(
        frame,
        color=np.asarray(color, np.uint8),
        depth=_depth(np.ascontiguousarray(frame.depth[part]), side, _from_centre(side)),
        intrinsics=whole.scaled(columns, rows),
    )


def _from_centre(side: int) -> Int64:
    """The pixels of a block [side², 2] as row and column, those nearest to its centre first."""
    offsets = np.array([(row, column) for row in range(side) for column in range(side)])
    distance = ((offsets - (side - 1) / 2) ** 2).sum(axis=1)
    return offsets[np.argsort(distance, kind="stable")]


@compiled
def _depth(depth: Float32, side: int, order: Int64) -> Float32:
    """Depth of each block [H / side, W / side], metres; NaN where no sample is valid."""
    rows, columns = depth.shape[0] // side, depth.shape[1] // side
    small = np.empty((rows, columns), np.float32)
    # all blocks of a row at once, sample by sample, so that loops are contiguous in memory
    samples = np.empty((side * side, columns), np.float32)
    nearest = np.empty(columns, np.float32)
    total = np.empty(columns, np.float32)
    count = np.empty(columns, np.float32)
    for row in range(rows):
        nearest[:] = np.nan
        for i in range(len(order)):
            v, left = row * side + order[i, 0], order[i, 1]
            for column in range(columns):
                samples[i, column] = depth[v, column * side + left]
            for column in range(columns):
                z = nearest[column]
                nearest[column] = samples[i, column] if np.isnan(z) else z
        total[:] = 0.0
        count[:] = 0.0
        for i in range(len(order)):
            for column in range(columns):
                z = samples[i, column]
                tolerance = np.float32(_SAME_SURFACE) * nearest[column]
                is_same = abs(z - nearest[column]) < tolerance
                total[column] += z if is_same else np.float32(0.0)
                count[column] += np.float32(1.0) if is_same else np.float32(0.0)
        for column in range(columns):
            small[row, column] = total[column] / count[column]
    return small
