"""MiniSpinNet's neighbourhoods against plain numpy, and what it should not depend on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rgbd_glue_ros.features.minispinnet import (
    _PATCH_POINTS,
    _RADIUS_M,
    cells,
    centres,
    describe,
    surroundings,
    upright,
)
from rgbd_glue_ros.features.weights import load
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.types import Float64

RADIUS, MOST = 0.8 / 3, 10


def bumpy_floor() -> Float64:
    """A surface seen from above that looks different everywhere, [N, 3], a point every 2 cm."""
    x, y = (grid.ravel() for grid in np.mgrid[-0.5:0.5:0.02, -0.5:0.5:0.02])
    z = 2 + 0.06 * np.sin(9 * x + 1) * np.cos(7 * y) + 0.03 * np.sin(17 * x * y)
    return np.stack([x, y, z], axis=1)


def test_cells_hold_the_first_points_in_their_balls_turned_back_by_their_azimuth() -> None:
    rng = np.random.default_rng(0)
    patch = rng.uniform(-1, 1, (1, 200, 3))
    sampled = cells(patch, centres(), RADIUS, MOST)
    assert sampled.shape == (1, 3, 3 * 7 * 20, MOST)
    for c, centre in enumerate(centres()):
        inside = patch[0][np.linalg.norm(patch[0] - centre, axis=1) < RADIUS][:MOST]
        turn = se3.exp(np.array([0, 0, 0, 0, 0, -2 * np.pi / 20 * (c % 20)]))[:3, :3]
        expected = np.zeros((MOST, 3))
        expected[: len(inside)] = inside @ turn.T
        np.testing.assert_allclose(sampled[0, :, c].T, expected, atol=1e-6)


def test_directions_are_turned_upright_by_the_least_rotation() -> None:
    directions = np.random.default_rng(0).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    directions = np.concatenate([directions, [[0, 0, 1], [0, 0, -1], [1e-12, 0, -1]]])
    R = upright(directions)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", R, directions)[:, 2], 1, atol=1e-9)
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (53, 1, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(R), 1, atol=1e-9)
    angle = np.arccos(np.clip((np.trace(R, axis1=1, axis2=2) - 1) / 2, -1, 1))
    np.testing.assert_allclose(angle, np.arccos(np.clip(directions[:, 2], -1, 1)), atol=1e-6)


def test_surroundings_are_what_is_near_with_the_normal_along_z() -> None:
    points = bumpy_floor()
    keypoints = points[[0, 40, 1275, 2000]]
    for keypoint, patch in zip(keypoints, surroundings(points, keypoints), strict=True):
        near = points[np.linalg.norm(points - keypoint, axis=1) <= _RADIUS_M] - keypoint
        assert patch.shape == (_PATCH_POINTS, 3)
        expected = np.sort(np.linalg.norm(near, axis=1))
        if len(near) < _PATCH_POINTS:
            there = np.sort(np.linalg.norm(patch, axis=1))[-len(near) :]
            np.testing.assert_allclose(there * _RADIUS_M, expected, atol=1e-9)
        assert (patch[-1] == 0).all()
        # least spread along z, and the camera on that side
        assert np.argmin((patch**2).sum(axis=0)) == 2


@pytest.mark.slow
def test_a_descriptor_stays_when_the_camera_moves(weights_folder: Path) -> None:
    torch = pytest.importorskip("torch")
    if not (weights_folder / "buffer_3dmatch_desc.pth").is_file():
        pytest.skip("the weights of BUFFER are not here")
    config = FeaturesConfig(weights=str(weights_folder))
    weights = load("buffer_3dmatch_desc.pth", config, "cpu").below("Desc")
    points = bumpy_floor()
    keypoints = points[np.linalg.norm(points[:, :2], axis=1) < 0.2][::7]
    T = se3.exp(np.array([0.3, -0.2, 0.1, 0.3, -0.4, 0.8]))
    described = []
    for pose in (np.eye(4), T):
        patches = surroundings(se3.transform(pose, points), se3.transform(pose, keypoints))
        with torch.inference_mode():
            sampled = torch.from_numpy(cells(patches, centres(), RADIUS, MOST))
            described.append(describe(sampled, weights).numpy())
    here, there = described
    assert here.shape == (len(keypoints), 32)
    np.testing.assert_allclose(np.linalg.norm(here, axis=1), 1, atol=1e-5)
    likeness = here @ there.T
    assert (likeness.argmax(axis=1) == np.arange(len(keypoints))).mean() > 0.8
