"""Features: those of OpenCV and Open3D, matched as equations say, silent where nothing is seen."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs.geometry import SEEDS, points_of
from rigs.room import CAMERA, TIMES, room_view, true_transform

from rgbd_glue_ros.features import GEOMETRIC, VISUAL
from rgbd_glue_ros.features.fpfh import BINS, grid_fpfh, guided_search
from rgbd_glue_ros.features.geometric import (
    DescribedPoints,
    GridFpfh,
    VoxelFpfh,
    nearest_matches,
)
from rgbd_glue_ros.features.lifting import lift
from rgbd_glue_ros.features.visual import OpenCvFeature, VisualMatches
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import project
from rgbd_glue_ros.geometry.fitting import distances
from rgbd_glue_ros.geometry.normals import grid_points_and_normals
from rgbd_glue_ros.parameters import GEOMETRIC_FEATURES, VISUAL_FEATURES, FeaturesConfig
from rgbd_glue_ros.types import Float64, TransformPrior, View

CONFIG = FeaturesConfig()
OPENCV = ["sift", "orb", "brisk"]
STEP = 8
PINHOLE = np.array([CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy])


def views() -> tuple[View, View]:
    return room_view(TIMES[0]), room_view(TIMES[1])


def blank() -> View:
    """A view that shows nothing and has no depth."""
    size = CAMERA.height, CAMERA.width
    return View(np.zeros(size, np.uint8), np.full(size, np.nan, np.float32), CAMERA)


def test_every_feature_that_can_be_configured_is_in_the_tables() -> None:
    assert {*VISUAL} == {*VISUAL_FEATURES}
    assert {*GEOMETRIC} == {*GEOMETRIC_FEATURES}


# visual


@pytest.mark.parametrize(
    ("name", "kind", "size"), [("sift", "f4", 128), ("orb", "u1", 32), ("brisk", "u1", 64)]
)
def test_a_feature_has_the_descriptors_of_its_name(name: str, kind: str, size: int) -> None:
    found = VISUAL[name](CONFIG).extract(room_view(0.0))
    assert found.descriptors.dtype == np.dtype(kind)
    assert found.descriptors.shape == (len(found.uv), size)
    assert 100 < len(found.uv) <= CONFIG.keypoints


@pytest.mark.parametrize("name", OPENCV)
def test_keypoints_and_descriptors_are_opencvs_the_strongest_first(name: str) -> None:
    detector = getattr(cv2, f"{name.upper()}_create")()
    keypoints, descriptors = detector.detectAndCompute(room_view(0.0).grey, None)
    found = OpenCvFeature(detector, FeaturesConfig(keypoints=200)).extract(room_view(0.0))
    response = np.array([k.response for k in keypoints])
    strongest = np.argsort(-response, kind="stable")[:200]
    assert len(keypoints) > 200
    np.testing.assert_array_equal(found.uv, [keypoints[i].pt for i in strongest])
    np.testing.assert_array_equal(found.descriptors, descriptors[strongest])


@pytest.mark.parametrize("name", OPENCV)
def test_matches_are_those_that_pass_the_ratio_test_the_best_one_for_each_target(name: str) -> None:
    feature = VISUAL[name](CONFIG)
    source, target = (feature.extract(view) for view in views())
    matches = feature.match(source, target)

    norm = cv2.NORM_L2 if name == "sift" else cv2.NORM_HAMMING
    best: dict[int, float] = {}
    for first, second in cv2.BFMatcher(norm).knnMatch(source.descriptors, target.descriptors, 2):
        ratio = first.distance / second.distance if second.distance else 1.0
        if ratio <= CONFIG.ratio:
            best[first.trainIdx] = min(ratio, best.get(first.trainIdx, 1.0))
    assert len(best) > 50
    expected = sorted((*target.uv[row], 1 - ratio) for row, ratio in best.items())
    found = np.column_stack([matches.target_uv, matches.weights])
    np.testing.assert_allclose(sorted(found.tolist()), expected, atol=1e-5)


@pytest.mark.parametrize("name", OPENCV)
def test_most_matches_of_two_views_are_right(name: str) -> None:
    feature = VISUAL[name](CONFIG)
    source, target = views()
    pixels = feature.match(feature.extract(source), feature.extract(target))
    matches = lift(pixels, points_of(source), points_of(target))
    assert len(matches) > 0.6 * len(pixels)
    assert (distances(true_transform(), matches) < 0.05).mean() > 0.6


@pytest.mark.parametrize("name", OPENCV)
def test_where_one_view_is_blank_nothing_is_matched(name: str) -> None:
    feature = VISUAL[name](CONFIG)
    something, nothing = feature.extract(room_view(0.0)), feature.extract(blank())
    for source, target in ((something, nothing), (nothing, something), (nothing, nothing)):
        assert len(feature.match(source, target)) == 0


@pytest.mark.parametrize("name", OPENCV)
@pytest.mark.parametrize("size", [(1, 1), (2, 3), (15, 16), (16, 16), (640, 1)])
def test_an_image_of_a_few_pixels_has_no_features(name: str, size: tuple[int, int]) -> None:
    noise = np.random.default_rng(0).integers(0, 256, size, np.uint8)
    view = View(noise, np.ones(size, np.float32), CAMERA.scaled(size[1], size[0]))
    assert len(VISUAL[name](CONFIG).extract(view).uv) < 3


def test_matches_are_lifted_where_both_depths_are_known() -> None:
    source, target = views()
    depth = np.array(target.depth)
    depth[:, :160] = np.nan
    target = View(target.grey, depth, target.intrinsics)
    uv = np.array([[100, 100], [200, 100], [-5, 0], [300.5, 200.25]], np.float32)
    weights = np.array([0.1, 0.2, 0.3, 0.4])
    lifted = lift(VisualMatches(uv, uv, weights), points_of(source), points_of(target))
    np.testing.assert_array_equal(lifted.weights, [0.2, 0.4])
    for points in (lifted.source, lifted.target):
        np.testing.assert_allclose(project(points, CAMERA), uv[[1, 3]], atol=1e-9)
    assert lifted.source[0, 2] == source.depth[100, 200]
    assert lifted.target[0, 2] == depth[100, 200]


def test_the_features_named_none_find_and_match_nothing() -> None:
    source, target = views()
    visual, geometric = VISUAL["none"](CONFIG), GEOMETRIC["none"](CONFIG)
    assert len(visual.match(visual.extract(source), visual.extract(target))) == 0
    rough = TransformPrior(np.eye(4), 1.0)
    assert len(geometric.match(geometric.extract(source), geometric.extract(target), rough)) == 0


# FPFH on the grid


def open3d_fpfh(open3d: Any, points: Float64, normals: Float64, search: Any) -> Float64:
    """Open3D's FPFH, [N, 33]."""
    described = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    described.normals = open3d.utility.Vector3dVector(normals)
    feature = open3d.pipelines.registration.compute_fpfh_feature(described, search)
    return np.asarray(feature.data.T, np.float64)


@pytest.mark.slow
@pytest.mark.every_python
def test_grid_fpfh_is_open3ds_on_the_same_points_normals_and_radius() -> None:
    open3d = pytest.importorskip("open3d")
    points, normals = grid_points_and_normals(room_view(0.0).depth, CAMERA, STEP)
    known = np.isfinite(points[..., 2])
    radius = 0.12
    # a window so wide that every point within the radius is in it
    described = grid_fpfh(points, normals, radius, half_window=20)
    search = open3d.geometry.KDTreeSearchParamRadius(radius)
    expected = open3d_fpfh(open3d, points[known], normals[known], search)
    np.testing.assert_allclose(described[known], expected, atol=2e-3)
    assert (described[~known] == 0).all()


def test_the_three_histograms_of_a_point_and_of_its_neighbours_sum_to_100_each() -> None:
    points, normals = grid_points_and_normals(room_view(0.0).depth, CAMERA, STEP)
    described = grid_fpfh(points, normals, 0.12, 3)
    sums = described.reshape(-1, 3, BINS).sum(axis=2)
    alone = (sums == 0).all(axis=1)
    np.testing.assert_allclose(sums[~alone], 200.0, rtol=1e-4)
    assert (~alone).mean() > 0.8


def test_a_point_without_neighbours_has_an_empty_histogram() -> None:
    points = np.full((3, 3, 3), np.nan)
    normals = np.full((3, 3, 3), np.nan)
    points[0, 0], points[2, 2] = (0, 0, 1), (0, 0, 2)
    normals[0, 0] = normals[2, 2] = (0, 0, -1)
    assert (grid_fpfh(points, normals, 0.5, 2) == 0).all()


def test_a_histogram_does_not_depend_on_where_the_camera_is() -> None:
    points, normals = grid_points_and_normals(room_view(0.0).depth, CAMERA, STEP)
    T = se3.exp(np.array([0.3, -0.2, 0.5, 0.1, 0.3, -0.2]))
    moved = points @ T[:3, :3].T + T[:3, 3]
    here, there = (
        grid_fpfh(points, normals, 0.12, 3),
        grid_fpfh(moved, normals @ T[:3, :3].T, 0.12, 3),
    )
    # but for angles on the edge of two bins, as there are many of on planes
    difference = np.abs(here - there).max(axis=2)
    assert np.median(difference) < 1.0


def balls(
    source: Float64, target: Float64, described: tuple[Float64, Float64], T: Float64, radius: float
) -> dict[tuple[float, ...], tuple[float, ...]]:
    """By comparing all with all: the nearest feature in the ball around each T p."""
    near = np.linalg.norm(se3.transform(T, source)[:, None] - target[None], axis=2) <= radius
    difference = np.linalg.norm(described[0][:, None] - described[1][None], axis=2)
    best = np.where(near, difference, np.inf).argmin(axis=1)
    found = near.any(axis=1)
    return {tuple(p): tuple(q) for p, q in zip(source[found], target[best[found]], strict=True)}


@given(SEEDS, st.sampled_from([0.05, 0.1, 0.3]))
@settings(max_examples=15)
def test_guided_search_finds_what_comparing_all_within_the_radius_finds(
    seed: int, radius: float
) -> None:
    rng = np.random.default_rng(seed)
    step = 16
    grids = [grid_points_and_normals(view.depth, CAMERA, step)[0] for view in views()]
    features = [rng.normal(size=(*grid.shape[:2], 4)).astype(np.float32) for grid in grids]
    # a transform that is off by a few centimetres
    T = se3.exp(rng.normal(0, 0.02, 6)) @ true_transform()
    p, q, distance = guided_search(
        grids[0], features[0], grids[1], features[1], T, PINHOLE, step, radius, half_window=50
    )
    known = [np.isfinite(grid[..., 2]) for grid in grids]
    source, target = (grid[mask] for grid, mask in zip(grids, known, strict=True))
    described = tuple(f[m].astype(np.float64) for f, m in zip(features, known, strict=True))
    expected = balls(source, target, (described[0], described[1]), T, radius)
    assert {tuple(a): tuple(b) for a, b in zip(p, q, strict=True)} == expected
    assert len(p) == len(distance) == len(expected)


def test_a_narrow_window_only_limits_how_far_it_looks() -> None:
    feature = GridFpfh(CONFIG)
    source, target = (feature.extract(view) for view in views())
    matches = feature.match(source, target, TransformPrior(true_transform(), 0.5))
    assert len(matches) > 500
    assert distances(true_transform(), matches).max() <= 0.5


def test_guided_matches_are_within_the_radius_and_weighted_by_likeness() -> None:
    feature = GridFpfh(CONFIG)
    source, target = (feature.extract(view) for view in views())
    matches = feature.match(source, target, TransformPrior(true_transform(), 0.05))
    assert len(matches) > np.isfinite(source.points[..., 2]).sum() / 3
    assert distances(true_transform(), matches).max() <= 0.05
    assert 0 < matches.weights.min() < matches.weights.max() <= 1


def test_nothing_is_guided_to_where_the_other_camera_does_not_look() -> None:
    feature = GridFpfh(CONFIG)
    source, target = (feature.extract(view) for view in views())
    behind = se3.exp(np.array([0, 0, -20.0, 0, 0, 0]))
    assert len(feature.match(source, target, TransformPrior(behind, 0.1))) == 0


# FPFH on voxels


def test_every_point_takes_its_nearest_neighbour_in_feature_space() -> None:
    rng = np.random.default_rng(0)
    source, target = (
        DescribedPoints(rng.normal(size=(n, 3)), rng.normal(size=(n, 5)).astype(np.float32))
        for n in (40, 60)
    )
    matches = nearest_matches(source, target)
    all_distances = np.linalg.norm(source.descriptors[:, None] - target.descriptors[None], axis=2)
    nearest = all_distances.argmin(axis=1)
    np.testing.assert_array_equal(matches.source, source.points)
    np.testing.assert_array_equal(matches.target, target.points[nearest])
    first, second = np.sort(all_distances, axis=1)[:, :2].T
    np.testing.assert_allclose(matches.weights, 1 - first / second, atol=1e-6)


@pytest.mark.parametrize("name", ["fpfh", "fpfh_grid"])
@pytest.mark.parametrize("known_pixels", [0, 1])
def test_where_one_view_has_no_depth_no_geometry_is_matched(name: str, known_pixels: int) -> None:
    depth = blank().depth
    depth[100, 100 : 100 + known_pixels] = 2.0
    feature = GEOMETRIC[name](CONFIG)
    something = feature.extract(room_view(0.0))
    nothing = feature.extract(View(blank().grey, depth, CAMERA))
    for source, target in ((something, nothing), (nothing, nothing)):
        assert len(feature.match(source, target, None)) == 0
    assert (
        len(feature.match(nothing, something, TransformPrior(true_transform(), 0.1)))
        <= known_pixels
    )


@pytest.mark.slow
def test_a_large_cloud_is_matched_in_part_to_all_of_the_other() -> None:
    source, target = (VoxelFpfh(CONFIG).extract(view) for view in views())
    whole = VoxelFpfh(CONFIG).match(source, target, None)
    part = VoxelFpfh(replace(CONFIG, geometric_matches=1000)).match(source, target, None)
    assert len(part) == 1000 < len(whole)
    rows = np.arange(1000) * len(whole) // 1000
    np.testing.assert_array_equal(part.target, whole.target[rows])


@pytest.mark.slow
def test_voxel_fpfh_finds_a_fair_part_of_its_matches_right_and_weights_them_more() -> None:
    feature = VoxelFpfh(CONFIG)
    # walls that are exactly flat look exactly alike, and rounding alone tells their points apart
    rng = np.random.default_rng(0)
    rough = (
        replace(view, depth=view.depth + rng.normal(0, 0.003, view.depth.shape).astype(np.float32))
        for view in views()
    )
    source, target = (feature.extract(view) for view in rough)
    matches = feature.match(source, target, None)
    right = distances(true_transform(), matches) < 0.05
    assert len(matches) == len(source.points)
    assert right.mean() > 0.05
    assert matches.weights[right].mean() > matches.weights[~right].mean()
