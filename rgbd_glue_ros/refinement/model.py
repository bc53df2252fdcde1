"""The model that poses are refined against: planes and textured pixels of a frame.

Each keeps the image row that it was seen in and the camera's velocity there, to compensate a
rolling shutter: the rows of an image are not taken at the same time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from operator import is_
from typing import TypeVar

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.depth import DEPTH_EDGE_SIGMAS, RECEDING, depth_sigma
from rgbd_glue_ros.geometry.motion_compensation import (
    camera_velocity_at,
    displaced_points,
    keypoints_to_points,
    normalised_row_time,
    seconds_after_color,
)
from rgbd_glue_ros.geometry.normals import grid_points_and_normals, spacing_px, widened_px
from rgbd_glue_ros.refinement.image_pyramid import ImagePyramid
from rgbd_glue_ros.types import Float32, Float64, Int64, Mask, UInt8, View

P = TypeVar("P", bound="ModelPoints")

LEVELS = 3
# Edge length of the cells, one pixel of the model each, for each pyramid level of a 640x480 image:
# coarse levels have fewer pixels, so their cells are smaller.
_CELLS_PX = (8, 5, 4)
# Least gradient of a textured pixel, grey levels per pixel in a well-lit image.
_MIN_GRADIENT = 5.0
# Pixels this close to a nearer surface are left out: when the camera moves they are covered or
# uncovered, and what is seen there moves with the edge and not with the pixel's own depth.
_OCCLUSION_PX = 3


@dataclass(frozen=True, kw_only=True)
class ModelPoints:
    """Points of a frame, with their motion and the image rows that they were seen in.

    Attributes:
        points: float64 [N, 3], metres.
        velocity: float64 [N, 3], ``camera_velocity_at`` when they were seen, m/s.
        row_time: float64 [N], ``normalised_row_time`` of the row that they were seen in.
    """

    points: Float64
    velocity: Float64
    row_time: Float64

    def moved(self: P, T: Float64) -> P:
        """The points in the frame that T [4, 4] maps to."""
        points = se3.transform(T, self.points)
        return replace(self, points=points, velocity=self.velocity @ T[:3, :3].T)

    def selected(self: P, which: Mask | slice) -> P:
        """Some of the points.

        Args:
            which: bool [N], or a slice.
        """
        names = [field.name for field in fields(self)]
        return replace(self, **{name: getattr(self, name)[which] for name in names})

    def concatenated(self: P, others: Sequence[P]) -> P:
        """These points, followed by those of others."""
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
        normals: float64 [N, 3], unit vectors.
    """

    normals: Float64

    def moved(self, T: Float64) -> Planes:
        """The planes in the frame that T [4, 4] maps to."""
        return replace(super().moved(T), normals=self.normals @ T[:3, :3].T)


@dataclass(frozen=True, kw_only=True)
class Pixels(ModelPoints):
    """Points with their brightness at one level of an image pyramid.

    Attributes:
        brightness: float64 [N], grey levels.
    """

    brightness: Float64


@dataclass(frozen=True)
class Model:
    """Planes and pixels to refine poses against, in one frame.

    Attributes:
        planes: oriented surface points.
        pixels: textured points, for each level of the pyramid, finest first.
    """

    planes: Planes
    pixels: tuple[Pixels, ...]

    def moved(self, T: Float64) -> Model:
        """The model in the frame that T [4, 4] maps to."""
        return Model(self.planes.moved(T), tuple(p.moved(T) for p in self.pixels))

    def without_pixels(self) -> Model:
        """The planes alone."""
        return replace(self, pixels=tuple(level.selected(slice(0)) for level in self.pixels))

    def selected(self, planes: Mask, pixels: Sequence[Mask]) -> Model:
        """A part of the model.

        Args:
            planes: bool [N], the planes to keep.
            pixels: bool [M] for each level, the pixels to keep.
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
    """Combines several models in the same frame into one of the size of a single model.

    Takes every n-th plane and pixel of n models: refining against more keyframes costs no more, and
    averages their errors.
    """
    every = slice(None, None, len(models))

    def blended(parts: Sequence[P]) -> P:
        first, *others = (part.selected(every) for part in parts)
        return first.concatenated(others)

    return Model(
        blended([model.planes for model in models]),
        tuple(blended([model.pixels[level] for model in models]) for level in range(LEVELS)),
    )


class LastBlend:
    """Blends models, and keeps the last blend: most frames are compared with the same keyframes."""

    def __init__(self) -> None:
        self._models: tuple[Model, ...] = ()
        self._blend: Model | None = None

    def of(self, models: Sequence[Model]) -> Model:
        """The blend of these models."""
        are_the_same = len(models) == len(self._models) and all(map(is_, models, self._models))
        if self._blend is None or not are_the_same:
            self._models, self._blend = tuple(models), blend(models)
        return self._blend


def _planes(view: View, grid_step: int) -> Planes:
    points, normals = grid_points_and_normals(
        view.depth, view.intrinsics, grid_step, view.depth_noise
    )
    known = np.isfinite(points[..., 2])
    rows = np.nonzero(known)[0] * grid_step + grid_step // 2
    seconds = seconds_after_color(rows, view)
    points = displaced_points(points[known], seconds, view.twist)
    # normals rotate like the points
    turn = seconds[:, np.newaxis] * np.cross(view.twist[3:], normals[known])
    return Planes(
        points=points,
        normals=normals[known] + turn,
        velocity=camera_velocity_at(points, view.twist),
        row_time=normalised_row_time(rows, view),
    )


def _textured_pixels(image: UInt8, level: int, view: View) -> Pixels:
    """The pixel with the strongest gradient in each cell of a level, if its depth is known."""
    least = _MIN_GRADIENT * view.contrast
    rows = _strongest_gradients(image, widened_px(view, _CELLS_PX[level]), least)
    reach = _OCCLUSION_PX * 2**level
    rows = rows[_uncovered(view.depth, rows * 2**level, reach, view.depth_noise)]
    uv = (rows[:, ::-1] * 2**level).astype(np.float32)
    points, known = keypoints_to_points(uv, view)
    return Pixels(
        points=points,
        brightness=image[rows[known, 0], rows[known, 1]].astype(np.float64),
        velocity=camera_velocity_at(points, view.twist),
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
            # differences are over two pixels
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
def _uncovered(depth: Float32, pixels: Int64, reach: int, noise: float) -> Mask:
    """Which pixels, int64 [N, 2] rows and columns, have no nearer surface within ``reach``."""
    height, width = depth.shape
    free = np.zeros(len(pixels), np.bool_)
    for i in range(len(pixels)):
        row, column = pixels[i, 0], pixels[i, 1]
        z = nearest = depth[row, column]
        for v in range(max(0, row - reach), min(height, row + reach + 1)):
            for u in range(max(0, column - reach), min(width, column + reach + 1)):
                nearest = min(nearest, depth[v, u])
        # false if depth is unknown
        step = DEPTH_EDGE_SIGMAS * noise * depth_sigma(nearest) + RECEDING * nearest
        free[i] = z - nearest < step
    return free
