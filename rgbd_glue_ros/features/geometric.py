"""The interface of geometric features; FPFH of voxels, and FPFH of the depth image's grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rgbd_glue_ros.features import voxels
from rgbd_glue_ros.features.fpfh import BINS, grid_fpfh, guided_search
from rgbd_glue_ros.features.matching import distance_ratio, nearest_two
from rgbd_glue_ros.geometry.camera import cloud
from rgbd_glue_ros.geometry.motion_compensation import displaced_points, seconds_after_color
from rgbd_glue_ros.geometry.normals import grid_points_and_normals, widened_px
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.types import (
    CameraIntrinsics,
    Correspondences,
    Float32,
    Float64,
    TransformPrior,
    View,
)

# Neighbourhoods in voxels, as in Open3D's and FCGF's registration examples.
_NORMAL_RADIUS_VOXELS, _NORMAL_NEIGHBOURS = 2.0, 30
_FPFH_RADIUS_VOXELS, _FPFH_NEIGHBOURS = 5.0, 100

_GRID_FPFH_RADIUS_M = 0.12
_GRID_FPFH_HALF_WINDOW = 3
_GUIDED_HALF_WINDOW = 4


class GeometricFeature(Protocol):
    """A way to find and match geometric features."""

    def extract(self, view: View) -> Any:
        """The geometric features of a frame."""

    def match(self, source: Any, target: Any, prior: TransformPrior | None) -> Correspondences:
        """C_geo; a guided search is limited to ``prior.radius`` around ``prior``."""


@dataclass(frozen=True)
class DescribedPoints:
    """Points with descriptors.

    Attributes:
        points: float64 [N, 3] in the optical frame, metres.
        descriptors: float32 [N, D].
    """

    points: Float64
    descriptors: Float32

    def thinned(self, most: int) -> DescribedPoints:
        """At most a given number of the points, spread evenly over their order."""
        if len(self.points) <= most:
            return self
        rows = np.arange(most) * len(self.points) // most
        return DescribedPoints(self.points[rows], self.descriptors[rows])


def nearest_matches(source: DescribedPoints, target: DescribedPoints) -> Correspondences:
    """Section 3.1: the nearest neighbour of every source point in feature space."""
    if len(source.points) == 0 or len(target.points) < 2:
        return Correspondences.empty()
    index, distances = nearest_two(source.descriptors, target.descriptors)
    return Correspondences(source.points, target.points[index], 1.0 - distance_ratio(distances))


class VoxelFpfh:
    """FPFH of a cloud thinned to voxels: the paper's."""

    def __init__(self, config: FeaturesConfig) -> None:
        self._voxel = config.voxel
        self._most = config.geometric_matches

    def extract(self, view: View) -> DescribedPoints:
        """Thins the cloud to one point per voxel and describes each."""
        points = voxels.voxel_means(cloud(view.depth, view.intrinsics), self._voxel)
        if not len(points):
            return DescribedPoints(points, np.empty((0, 3 * BINS), np.float32))
        near = voxels.neighbourhoods(points, _FPFH_RADIUS_VOXELS * self._voxel, _FPFH_NEIGHBOURS)
        normals = voxels.normals(
            points, *near, _NORMAL_RADIUS_VOXELS * self._voxel, _NORMAL_NEIGHBOURS
        )
        return DescribedPoints(points, voxels.fpfh(points, normals, *near))

    def match(
        self,
        source: DescribedPoints,
        target: DescribedPoints,
        prior: TransformPrior | None,  # noqa: ARG002 - the paper matches first and filters after
    ) -> Correspondences:
        """Section 3.1."""
        return nearest_matches(source.thinned(self._most), target)


@dataclass(frozen=True)
class DescribedGrid:
    """A grid of points of the depth image with descriptors.

    Attributes:
        points: float64 [rows, columns, 3] in the optical frame, metres; NaN where unknown.
        descriptors: float32 [rows, columns, 33].
        intrinsics: of the depth image.
        step: pixels between grid points.
    """

    points: Float64
    descriptors: Float32
    intrinsics: CameraIntrinsics
    step: int

    def known(self) -> DescribedPoints:
        """The points that are known, as rows."""
        mask = np.isfinite(self.points[..., 2])
        return DescribedPoints(self.points[mask], self.descriptors[mask])


class GridFpfh:
    """FPFH on the depth image's own grid; its matching is guided by the rough transform."""

    def __init__(self, config: FeaturesConfig) -> None:
        self._step = config.grid_step

    def extract(self, view: View) -> DescribedGrid:
        """Points, normals and FPFH of a grid that has no more points in a larger image."""
        step = widened_px(view, self._step)
        points, normals = grid_points_and_normals(
            view.depth, view.intrinsics, step, view.depth_noise
        )
        rows = np.arange(len(points)) * step + step // 2
        points = displaced_points(
            points, seconds_after_color(rows, view)[:, np.newaxis], view.twist
        )
        fpfh = grid_fpfh(points, normals, _GRID_FPFH_RADIUS_M, _GRID_FPFH_HALF_WINDOW)
        return DescribedGrid(points, fpfh, view.intrinsics, step)

    def match(
        self, source: DescribedGrid, target: DescribedGrid, prior: TransformPrior | None
    ) -> Correspondences:
        """Guided search within the radius; without a prior, nearest neighbours everywhere."""
        if prior is None:
            return nearest_matches(source.known(), target.known())
        p, q, distance = guided_search(
            source.points,
            source.descriptors,
            target.points,
            target.descriptors,
            prior.T_target_source,
            target.intrinsics.focal_and_centre,
            target.step,
            prior.radius,
            _GUIDED_HALF_WINDOW,
        )
        # the norm of a histogram triple is at most 3 · 200, and few differ by more than 200
        return Correspondences(p, q, 1.0 / (1.0 + (distance / 100.0) ** 2))


class NoGeometricFeature:
    """No geometric feature: registration by visual correspondences alone."""

    def extract(self, view: View) -> None:
        """Nothing."""

    def match(
        self,
        source: None,  # noqa: ARG002
        target: None,  # noqa: ARG002
        prior: TransformPrior | None,  # noqa: ARG002
    ) -> Correspondences:
        """No matches."""
        return Correspondences.empty()
