"""What poses are refined against: the planes and the textured pixels of a frame.

Each keeps the row it was seen in and how fast it passed, so that a rolling shutter can be allowed
for: the rows of an image are not of one moment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.depth import DEPTH_EDGE_SIGMAS, RECEDING, depth_sigma
from rgbd_glue_ros.geometry.motion_compensation import (
    apparent_velocity,
    displaced_points,
    keypoints_to_points,
    normalised_row_time,
    seconds_after_color,
)
from rgbd_glue_ros.geometry.normals import grid_points_and_normals, spacing_px, widened_px
from rgbd_glue_ros.refinement.image_pyramid import ImagePyramid
from rgbd_glue_ros.types import Float32, Float64, Int64, UInt8, View

Mask = NDArray[np.bool_]
P = TypeVar("P", bound="ModelPoints")

LEVELS = 3
# Edge of the cells that give one pixel each, at every level of the pyramid of an image of 640x480:
# coarse levels have fewer pixels, so their cells are smaller.
_CELLS_PX = (8, 5, 4)
# Grey levels a pixel, in a well-lit image.
_MIN_GRADIENT = 5.0
# A pixel this near to a nearer surface is covered or uncovered when the camera moves, and what is
# seen there moves with the edge and not with the pixel's own depth.
_OCCLUSION_PX = 3


@dataclass(frozen=True, kw_only=True)
class ModelPoints:
    """Points of a frame, and how they were seen.

    Attributes:
        points: float64 [N, 3], metres.
        velocity: float64 [N, 3], ``apparent_velocity`` when they were seen, m/s.
        row_time: float64 [N], ``normalised_row_time`` of the row that they were seen in.
    """

    points: Float64
    velocity: Float64
    row_time: Float64

    def moved(self: P, T: Float64) -> P:
        """The same in the frame that T [4, 4] maps to."""
        points = se3.transform(T, self.points)
        return replace(self, points=points, velocity=self.velocity @ T[:3, :3].T)

    def selected(self: P, which: Mask | slice) -> P:
        """Some of them.

        Args:
            which: bool [N], or a slice.
        """
        names = [field.name for field in fields(self)]
        return replace(self, **{name: getattr(self, name)[which] for name in names})

    def concatenated(self: P, others: Sequence[P]) -> P:
        """These, and those of others behind them."""
        names = [field.name for field in fields(self)]
        parts = [self, *others]
        return replace(
            self,
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names},
        )


@dataclass(frozen=True, kw_only=True)
class Planes(ModelPoints):
    """Oriented points.

    Attributes:
        normals: float64 [N, 3], unit.
    """

    normals: Float64

    def moved(self, T: Float64) -> Planes:
        """The planes in the frame that T [4, 4] maps to."""
        return replace(super().moved(T), normals=self.normals @ T[:3, :3].T)


@dataclass(frozen=True, kw_only=True)
class Pixels(ModelPoints):
    """Points with the brightness that one level of an image pyramid has there.

    Attributes:
        brightness: float64 [N], grey levels.
    """

    brightness: Float64


@dataclass(frozen=True)
class Model:
    """What poses are refined against, in one frame.

    Attributes:
        planes: surfaces.
        pixels: textured points, for each level of the pyramid, finest first.
    """

    planes: Planes
    pixels: tuple[Pixels, ...]

    def moved(self, T: Float64) -> Model:
        """The model in the frame that T [4, 4] maps to."""
        return Model(self.planes.moved(T), tuple(p.moved(T) for p in self.pixels))

    def selected(self, planes: Mask, pixels: Sequence[Mask]) -> Model:
        """A part of the model.

        Args:
            planes: bool [N], which.
            pixels: bool [M] for each level, which.
        """
        levels = zip(self.pixels, pixels, strict=True)
        return Model(self.planes.selected(planes), tuple(p.selected(mask) for p, mask in levels))


def model_of(view: View, grid_step: int) -> Model:
    """The planes and pixels of a frame, in its optical frame.

    Args:
        view: the frame.
        grid_step: spacing of the planes in an image of 640x480, pixels.
    """
    images = ImagePyramid(view.grey)
    pixels = tuple(_textured_pixels(images.at_level(level), level, view) for level in range(LEVELS))
    return Model(_planes(view, spacing_px(view, grid_step)), pixels)


def blend(models: Sequence[Model]) -> Model:
    """One model of several that are in the same frame, of the size of one of them.

    Takes every n-th plane and pixel of n models: to refine against more keyframes costs no more,
    and averages their errors.
    """
    every = slice(None, None, len(models))

    def blended(parts: Sequence[P]) -> P:
        first, *others = (part.selected(every) for part in parts)
        return first.concatenated(others)

    return Model(
        blended([model.planes for model in models]),
        tuple(blended([model.pixels[level] for model in models]) for level in range(LEVELS)),
    )


def _planes(view: View, grid_step: int) -> Planes:
    points, normals = grid_points_and_normals(view.depth, view.intrinsics, grid_step)
    known = np.isfinite(points[..., 2])
    rows = np.nonzero(known)[0] * grid_step + grid_step // 2
    seconds = seconds_after_color(rows, view)
    points = displaced_points(points[known], seconds, view.twist)
    # a normal turns as the points do
    turn = seconds[:, np.newaxis] * np.cross(view.twist[3:], normals[known])
    return Planes(
        points=points,
        normals=normals[known] + turn,
        velocity=apparent_velocity(points, view.twist),
        row_time=normalised_row_time(rows, view),
    )


def _textured_pixels(image: UInt8, level: int, view: View) -> Pixels:
    """The pixel with the strongest gradient in each cell of a level, where its depth is known."""
    least = _MIN_GRADIENT * view.contrast
    rows = _strongest_gradients(image, widened_px(view, _CELLS_PX[level]), least)
    rows = rows[_uncovered(view.depth, rows * 2**level, _OCCLUSION_PX * 2**level)]
    uv = (rows[:, ::-1] * 2**level).astype(np.float32)
    points, known = keypoints_to_points(uv, view)
    return Pixels(
        points=points,
        brightness=image[rows[known, 0], rows[known, 1]].astype(np.float64),
        velocity=apparent_velocity(points, view.twist),
        row_time=normalised_row_time(uv[known, 1], view),
    )


@compiled
def _strongest_gradients(image: UInt8, cell: int, threshold: float) -> Int64:
    """Row and column, int64 [N, 2], of the strongest gradient above the threshold in each cell."""
    height, width = image.shape
    pixels = np.empty(((height // cell + 1) * (width // cell + 1), 2), np.int64)
    n = 0
    for top in range(2, height - 2, cell):
        for left in range(2, width - 2, cell):
            best = (2.0 * threshold) ** 2
            row, column = -1, -1
            for v in range(top, min(top + cell, height - 2)):
                for u in range(left, min(left + cell, width - 2)):
                    du = float(image[v, u + 1]) - float(image[v, u - 1])
                    dv = float(image[v + 1, u]) - float(image[v - 1, u])
                    if du * du + dv * dv > best:
                        best, row, column = du * du + dv * dv, v, u
            if row >= 0:
                pixels[n, 0], pixels[n, 1] = row, column
                n += 1
    return pixels[:n]


@compiled
def _uncovered(depth: Float32, pixels: Int64, reach: int) -> NDArray[np.bool_]:
    """Which pixels, int64 [N, 2] rows and columns, have no nearer surface within ``reach``."""
    height, width = depth.shape
    free = np.zeros(len(pixels), np.bool_)
    for i in range(len(pixels)):
        row, column = pixels[i, 0], pixels[i, 1]
        z = nearest = depth[row, column]
        for v in range(max(0, row - reach), min(height, row + reach + 1)):
            for u in range(max(0, column - reach), min(width, column + reach + 1)):
                nearest = min(nearest, depth[v, u])
        # where depth is unknown this is false
        free[i] = z - nearest < DEPTH_EDGE_SIGMAS * depth_sigma(nearest) + RECEDING * nearest
    return free
