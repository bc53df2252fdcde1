"""A cloud is where the surfaces are, in their colours, and survives its file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames, true_poses

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.slam.cloud import ColoredCloud, cloud_of, fused, write_ply
from rgbd_glue_ros.types import CameraIntrinsics, RgbdFrame

CAMERA = CameraIntrinsics(160, 120, 150.0, 150.0, 79.5, 59.5)
BOX = slice(40, 80)


def wall_and_box() -> RgbdFrame:
    """A blue wall at 2 m, a red box before it at 1 m, and nothing known along the left."""
    color = np.tile(np.array([0, 0, 200], np.uint8), (120, 160, 1))
    depth = np.full((120, 160), 2.0, np.float32)
    color[BOX, BOX], depth[BOX, BOX] = (200, 0, 0), 1.0
    depth[:, :10] = np.nan
    return RgbdFrame(0, color, depth, CAMERA)


def test_points_lie_on_the_surfaces_in_their_colours() -> None:
    cloud = cloud_of(wall_and_box())
    is_box = cloud.points[:, 2] < 1.5
    assert 100 < is_box.sum() < len(cloud) / 2
    np.testing.assert_allclose(cloud.points[is_box, 2], 1.0, atol=1e-6)
    np.testing.assert_allclose(cloud.points[~is_box, 2], 2.0, atol=1e-6)
    assert (cloud.colors[is_box] == (200, 0, 0)).all()
    assert (cloud.colors[~is_box] == (0, 0, 200)).all()


def test_a_slanted_wall_reaches_to_the_borders_of_the_image() -> None:
    along = np.linspace(1.0, 3.0, CAMERA.width, dtype=np.float32)
    color = np.full((CAMERA.height, CAMERA.width), 100, np.uint8)
    for depth in (np.tile(along, (CAMERA.height, 1)), np.tile(along[: CAMERA.height, None], 160)):
        cloud = cloud_of(RgbdFrame(0, color, depth, CAMERA), 1e-4)
        # every second pixel of every second row
        assert len(cloud) == depth.size // 4


def test_two_views_of_a_room_are_one_cloud_where_poses_are_right_and_double_where_not() -> None:
    rows = (0, 20, 40)
    clouds = [cloud_of(recorded_frames()[row]) for row in rows]
    poses = true_poses()[list(rows)]
    # coarse, so that points of two views meet in a voxel
    right = fused(clouds, poses, 0.03)
    poses[1] = poses[1] @ se3.exp(np.array([0, 0, 0.2, 0, 0, 0]))
    assert len(fused(clouds, poses, 0.03)) > 1.1 * len(right)


def test_nothing_makes_an_empty_cloud() -> None:
    assert len(fused([], np.empty((0, 4, 4)))) == 0
    size = CAMERA.height, CAMERA.width
    dark = RgbdFrame(0, np.zeros(size, np.uint8), np.full(size, np.nan, np.float32), CAMERA)
    assert len(fused([cloud_of(dark)], np.eye(4)[None])) == 0


def test_a_ply_file_is_read_back_by_open3d(tmp_path: Path) -> None:
    open3d = pytest.importorskip("open3d", reason="Open3D is not installed")
    cloud = cloud_of(wall_and_box())
    write_ply(tmp_path / "new" / "map.ply", cloud)
    read = open3d.io.read_point_cloud(str(tmp_path / "new" / "map.ply"))
    np.testing.assert_allclose(np.asarray(read.points), cloud.points, atol=1e-6)
    np.testing.assert_allclose(255 * np.asarray(read.colors), cloud.colors, atol=0.01)


def test_a_file_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    cloud = ColoredCloud(np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8))
    with pytest.raises(InputError, match="cannot be written"):
        write_ply(tmp_path / "file" / "map.ply", cloud)
