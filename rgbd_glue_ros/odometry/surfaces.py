"""The surfaces in a view, block by block, and which of them another view should have seen."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.depth import surface_tolerance
from rgbd_glue_ros.refinement.projection import NEAREST_M
from rgbd_glue_ros.types import Float32, Float64, Mask, UInt8, View

BLOCK_PX = 8
"""Edge length of a block. Pose errors of up to as many pixels do no harm."""
# Edge of the neighbourhood of a block, blocks.
_AROUND = 3


@dataclass(frozen=True)
class Surfaces:
    """A depth image in blocks of ``BLOCK_PX``, and where it was taken.

    Attributes:
        depth: float32 [R, C], depth of the pixel in the middle of each block, metres; NaN where
            unknown.
        nearest: float32 [R, C], smallest depth in a block and those around it, metres; NaN in a
            block without known depth.
        K: float64 [4], fx, fy, cx, cy of the image.
        T_track_depth: float64 [4, 4], the camera's pose when depth was taken.
        noise: of depth, relative to ``depth_sigma``.
    """

    depth: Float32
    nearest: Float32
    K: Float64
    T_track_depth: Float64
    noise: float = 1.0

    @staticmethod
    def seen(view: View, T_track_camera: Float64) -> Surfaces:
        """The surfaces of a view with its pose, float64 [4, 4]; none in less than one block."""
        rows, columns = (size // BLOCK_PX for size in view.depth.shape)
        middle = slice(BLOCK_PX // 2, None, BLOCK_PX)
        return Surfaces(
            np.ascontiguousarray(view.depth[middle, middle][:rows, :columns]),
            _nearest_surfaces(view.depth),
            view.intrinsics.focal_and_centre,
            depth_pose(view, T_track_camera),
            view.depth_noise,
        )

    def moved(self, T: Float64) -> Surfaces:
        """The surfaces in the frame that T [4, 4] maps the track frame to."""
        return replace(self, T_track_depth=T @ self.T_track_depth)

    def in_front_of(self, other: Surfaces) -> UInt8:
        """Blocks in front of everything that another view sees there, uint8 [R, C], 1 or 0."""
        T_other_depth = se3.inverse(other.T_track_depth) @ self.T_track_depth
        in_front = _in_front(
            self.depth, self.K, T_other_depth, other.nearest, other.K, max(self.noise, other.noise)
        )
        return np.asarray(in_front, np.uint8)


def depth_pose(view: View, T_track_camera: Float64) -> Float64:
    """T_track_depth [4, 4]: the pose when the depth of a view with this pose was taken."""
    return T_track_camera @ se3.exp(view.twist * view.depth_delay)


def dense(blocks: UInt8) -> UInt8:
    """The blocks, uint8 [R, C], 1 or 0, whose neighbours are mostly 1."""
    around = cv2.boxFilter(blocks, -1, (_AROUND, _AROUND), normalize=False)
    return np.asarray(blocks & (around > _AROUND**2 // 2), np.uint8)


def widened(blocks: UInt8) -> UInt8:
    """The blocks, uint8 [R, C], 1 or 0, and their neighbours, where depth mixes surfaces."""
    return np.asarray(cv2.dilate(blocks, np.ones((_AROUND, _AROUND), np.uint8)), np.uint8)


def pixels_of(blocks: UInt8, view: View) -> Mask:
    """The pixels of blocks [R, C] that are not 0, bool [H, W]; beyond all blocks, of the last."""
    pixels = (blocks > 0).repeat(BLOCK_PX, axis=0).repeat(BLOCK_PX, axis=1)
    missing = np.subtract(view.depth.shape, pixels.shape)
    return np.pad(pixels, [(0, missing[0]), (0, missing[1])], mode="edge")


def _nearest_surfaces(depth: Float32) -> Float32:
    """Smallest depth in each block and its neighbours, float32 [R, C]; NaN in empty blocks."""
    blocks = _least_of_blocks(depth)
    if blocks.size == 0:
        return blocks
    around = cv2.erode(blocks, np.ones((_AROUND, _AROUND), np.uint8))
    return np.asarray(np.where(np.isinf(blocks), np.nan, around), np.float32)


@compiled
def _least_of_blocks(depth: Float32) -> Float32:
    """Smallest depth of every second pixel in each block, float32 [R, C].

    Infinite where depth is unknown.
    """
    rows, columns = depth.shape[0] // BLOCK_PX, depth.shape[1] // BLOCK_PX
    blocks = np.full((rows, columns), np.float32(np.inf))
    for v in range(0, rows * BLOCK_PX, 2):
        for u in range(0, columns * BLOCK_PX, 2):
            # a comparison with NaN is false, whereas min would return it
            if depth[v, u] < blocks[v // BLOCK_PX, u // BLOCK_PX]:  # noqa: PLR1730
                blocks[v // BLOCK_PX, u // BLOCK_PX] = depth[v, u]
    return blocks


@compiled
def _in_front(
    depth: Float32,
    K: Float64,
    T_other_depth: Float64,
    nearest: Float32,
    K_other: Float64,
    noise: float,
) -> UInt8:
    """1 in blocks that are in front of everything that another depth image has there.

    Args:
        depth: float32 [R, C], depth of the blocks, metres.
        K: fx, fy, cx, cy of their image.
        T_other_depth: from this camera to the other, float64 [4, 4].
        nearest: float32 [R, C], ``nearest`` of the other image.
        K_other: fx, fy, cx, cy of the other image.
        noise: of depth, relative to ``depth_sigma``.
    """
    in_front = np.zeros(depth.shape, np.uint8)
    T = T_other_depth
    for r in range(depth.shape[0]):
        v = r * BLOCK_PX + BLOCK_PX // 2
        for c in range(depth.shape[1]):
            u = c * BLOCK_PX + BLOCK_PX // 2
            z = depth[r, c]
            x, y = (u - K[2]) / K[0] * z, (v - K[3]) / K[1] * z
            there = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            # false for NaN, too
            if not there > NEAREST_M:
                continue
            right = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
            down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
            row = math.floor((K_other[1] * down / there + K_other[3]) / BLOCK_PX)
            column = math.floor((K_other[0] * right / there + K_other[2]) / BLOCK_PX)
            if 0 <= row < nearest.shape[0] and 0 <= column < nearest.shape[1]:
                known = nearest[row, column]
                if there < known - surface_tolerance(known, noise):
                    in_front[r, c] = 1
    return in_front
