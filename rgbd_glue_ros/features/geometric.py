"""What a geometric feature is; FPFH of voxels by Open3D, and FPFH of the depth image's grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rgbd_glue_ros.camera import cloud
from rgbd_glue_ros.config import FeaturesConfig
from rgbd_glue_ros.errors import MissingExtraError
from rgbd_glue_ros.features.fpfh import grid_fpfh, guided_search
from rgbd_glue_ros.matching import distance_ratio, nearest_two
from rgbd_glue_ros.normals import grid_points_and_normals
from rgbd_glue_ros.types import CameraIntrinsics, Correspondences, Float32, Float64, View

# Neighbourhoods in voxels, as Open3D's and FCGF's registration examples take them.
_NORMAL_RADIUS_VOXELS, _NORMAL_NEIGHBOURS = 2.0, 30
_FPFH_RADIUS_VOXELS, _FPFH_NEIGHBOURS = 5.0, 100

_GRID_FPFH_RADIUS_M = 0.12
_GRID_FPFH_HALF_WINDOW = 3
_GUIDED_HALF_WINDOW = 4


@dataclass(frozen=True)
class Rough:
    """A rough transform and how far a correct match may lie from it.

    Attributes:
        T_target_source: float64 [4, 4].
        radius: epsilon, metres.
    """

    T_target_source: Float64
    radius: float


class GeometricFeature(Protocol):
    """A way to find and match geometric features."""

    def extract(self, view: View) -> Any:
        """The geometric features of a frame."""

    def match(self, source: Any, target: Any, rough: Rough | None) -> Correspondences:
        """C_geo; a search that can be guided looks only within ``rough.radius`` of ``rough``."""


@dataclass(frozen=True)
class DescribedPoints:
    """Points with descriptors.

    Attributes:
        points: float64 [N, 3] in the optical frame, metres.
        descriptors: float32 [N, D].
    """

    points: Float64
    descriptors: Float32


def nearest_matches(source: DescribedPoints, target: DescribedPoints) -> Correspondences:
    """Section 3.1: the nearest neighbour of every source point in feature space."""
    if len(source.points) == 0 or len(target.points) < 2:
        return Correspondences.empty()
    index, distances = nearest_two(source.descriptors, target.descriptors)
    return Correspondences(source.points, target.points[index], 1.0 - distance_ratio(distances))


class VoxelFpfh:
    """FPFH on a voxel grid, computed by Open3D: the reference of the paper's experiments."""

    def __init__(self, config: FeaturesConfig) -> None:
        try:
            import open3d  # noqa: PLC0415 - takes seconds and is optional
        except ImportError as error:
            raise MissingExtraError("open3d", "open3d", "features.geometric: fpfh") from error
        self._open3d = open3d
        self._voxel = config.voxel

    def extract(self, view: View) -> DescribedPoints:
        """Thins the cloud to one point a voxel and describes each."""
        o3d = self._open3d
        points = o3d.geometry.PointCloud(
            o3d.utility.Vector3dVector(cloud(view.depth, view.intrinsics))
        )
        if points.is_empty():
            return DescribedPoints(np.empty((0, 3)), np.empty((0, 1), np.float32))
        points = points.voxel_down_sample(self._voxel)
        search = o3d.geometry.KDTreeSearchParamHybrid
        points.estimate_normals(search(_NORMAL_RADIUS_VOXELS * self._voxel, _NORMAL_NEIGHBOURS))
        points.orient_normals_towards_camera_location(np.zeros(3))
        fpfh = o3d.pipelines.registration.compute_fpfh_feature(
            points, search(_FPFH_RADIUS_VOXELS * self._voxel, _FPFH_NEIGHBOURS)
        )
        return DescribedPoints(
            np.asarray(points.points), np.ascontiguousarray(fpfh.data.T, np.float32)
        )

    def match(
        self,
        source: DescribedPoints,
        target: DescribedPoints,
        rough: Rough | None,  # noqa: ARG002 - the paper matches first and filters after
    ) -> Correspondences:
        """Section 3.1."""
        return nearest_matches(source, target)


@dataclass(frozen=True)
class DescribedGrid:
    """A grid of points of the depth image with normals and descriptors.

    Attributes:
        points: float64 [rows, columns, 3] in the optical frame, metres; NaN where unknown.
        normals: float64 [rows, columns, 3], unit, towards the camera.
        descriptors: float32 [rows, columns, 33].
        intrinsics: of the depth image.
        step: pixels between grid points.
    """

    points: Float64
    normals: Float64
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
        """Points, normals and FPFH of every ``grid_step``-th pixel."""
        points, normals = grid_points_and_normals(view.depth, view.intrinsics, self._step)
        fpfh = grid_fpfh(points, normals, _GRID_FPFH_RADIUS_M, _GRID_FPFH_HALF_WINDOW)
        return DescribedGrid(points, normals, fpfh, view.intrinsics, self._step)

    def match(
        self, source: DescribedGrid, target: DescribedGrid, rough: Rough | None
    ) -> Correspondences:
        """Guided search within the radius; without a guide, nearest neighbours everywhere."""
        if rough is None:
            return nearest_matches(source.known(), target.known())
        K = target.intrinsics
        p, q, distance = guided_search(
            source.points,
            source.descriptors,
            target.points,
            target.descriptors,
            rough.T_target_source,
            np.array([K.fx, K.fy, K.cx, K.cy]),
            target.step,
            rough.radius,
            _GUIDED_HALF_WINDOW,
        )
        # a histogram triple's norm is at most 3 · 200, and few differ by more than 200
        return Correspondences(p, q, 1.0 / (1.0 + (distance / 100.0) ** 2))


class NoGeometricFeature:
    """No geometric feature: registration by visual correspondences alone."""

    def extract(self, view: View) -> None:
        """Nothing."""

    def match(
        self,
        source: None,  # noqa: ARG002
        target: None,  # noqa: ARG002
        rough: Rough | None,  # noqa: ARG002
    ) -> Correspondences:
        """No matches."""
        return Correspondences.empty()
