"""Voxels: thinned, oriented and described as Open3D does it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from rigs.geometry import room_points
from rigs.room import CAMERA, true_depth, true_pose

from rgbd_glue_ros.features import voxels
from rgbd_glue_ros.geometry.camera import cloud
from rgbd_glue_ros.types import Float64

EDGE_M = 0.05
RADIUS_M, MOST = 0.25, 100
NORMAL_RADIUS_M, NORMAL_MOST = 0.1, 30


@lru_cache(maxsize=1)
def noisy_cloud() -> Float64:
    """A room whose points are nowhere equally far apart, so that neighbours have one order."""
    depth = true_depth(true_pose(0.0))
    noise = np.random.default_rng(0).normal(0, 0.003, depth.shape)
    return cloud((depth + noise).astype(np.float32), CAMERA)


@pytest.mark.slow
def test_the_means_are_those_of_open3d() -> None:
    open3d = pytest.importorskip("open3d")
    points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(noisy_cloud()))
    expected = np.asarray(points.voxel_down_sample(EDGE_M).points)
    ours = voxels.voxel_means(noisy_cloud(), EDGE_M)
    np.testing.assert_allclose(
        ours[np.lexsort(ours.T)], expected[np.lexsort(expected.T)], atol=1e-12
    )


def test_neighbours_are_the_nearest_ones_within_the_radius() -> None:
    points = room_points(np.random.default_rng(1), 300)
    numbers, distances = voxels.neighbourhoods(points, 0.5, 8)
    between = np.linalg.norm(points[:, None] - points, axis=2)
    for row, (found, apart) in enumerate(zip(numbers, distances, strict=True)):
        nearest = np.argsort(between[row])[:8]
        nearest = nearest[between[row, nearest] < 0.5]
        assert found[: len(nearest)].tolist() == nearest.tolist()
        np.testing.assert_allclose(apart[: len(nearest)], between[row, nearest])
        assert np.isinf(apart[len(nearest) :]).all()


def test_normals_are_those_of_open3d_towards_the_camera() -> None:
    open3d = pytest.importorskip("open3d")
    points = voxels.voxel_means(noisy_cloud(), EDGE_M)
    near = voxels.neighbourhoods(points, RADIUS_M, MOST)
    normals = voxels.normals(points, *near, NORMAL_RADIUS_M, NORMAL_MOST)
    theirs = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    search = open3d.geometry.KDTreeSearchParamHybrid(NORMAL_RADIUS_M, NORMAL_MOST)
    theirs.estimate_normals(search)
    theirs.orient_normals_towards_camera_location(np.zeros(3))
    assert (np.einsum("ij,ij->i", normals, points) <= 0).all()
    cosines = np.einsum("ij,ij->i", normals, np.asarray(theirs.normals))
    assert np.quantile(cosines, 0.01) > 0.9999


def test_fpfh_is_open3ds_on_the_same_points_and_normals() -> None:
    open3d = pytest.importorskip("open3d")
    points = voxels.voxel_means(noisy_cloud(), EDGE_M)
    # of two points with one normal, rounding would decide which is the pair's source
    normals = np.random.default_rng(0).normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    ours = voxels.fpfh(points, normals, *voxels.neighbourhoods(points, RADIUS_M, MOST))
    theirs = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    theirs.normals = open3d.utility.Vector3dVector(normals)
    search = open3d.geometry.KDTreeSearchParamHybrid(RADIUS_M, MOST)
    feature = open3d.pipelines.registration.compute_fpfh_feature(theirs, search)
    np.testing.assert_allclose(ours, feature.data.T, atol=1e-3)


def test_a_point_alone_looks_at_the_camera_and_has_an_empty_histogram() -> None:
    points = np.array([[0.0, 0.0, 2.0], [1.0, 1.0, 1.0]])
    near = voxels.neighbourhoods(points, RADIUS_M, MOST)
    normals = voxels.normals(points, *near, NORMAL_RADIUS_M, NORMAL_MOST)
    np.testing.assert_allclose(normals, -points / np.linalg.norm(points, axis=1)[:, None])
    assert not voxels.fpfh(points, normals, *near).any()
