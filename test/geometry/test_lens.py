"""Lens models against their own formulas."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rgbd_glue_ros.geometry.lens import rays, undistortion_maps
from rgbd_glue_ros.geometry.views import rectified
from rgbd_glue_ros.types import CameraIntrinsics, Float64, LensModel, RgbdFrame

PINHOLE = CameraIntrinsics(160, 120, 120.0, 121.0, 79.5, 59.5)
D = (0.08, -0.05, 0.002, -0.003, 0.01)
CAMERAS = {
    "brown": replace(PINHOLE, distortion=D),
    "rational": replace(PINHOLE, distortion=(*D, 0.02, -0.01, 0.005)),
    "thin prism": replace(PINHOLE, distortion=(*D, 0, 0, 0, 0.01, 0, -0.02, 0)),
    "tilted": replace(PINHOLE, distortion=(*D, 0, 0, 0, 0, 0, 0, 0, 0.02, -0.01)),
    "inverse": replace(PINHOLE, distortion=D, lens=LensModel.INVERSE_BROWN_CONRADY),
    "fisheye": replace(
        PINHOLE, distortion=(0.05, -0.02, 0.01, -0.003), lens=LensModel.KANNALA_BRANDT
    ),
}


def fisheye(x: Float64, y: Float64, k: tuple[float, ...]) -> tuple[Float64, Float64]:
    """Kannala and Brandt: the radius is a polynomial in the angle to the axis."""
    r = np.hypot(x, y)
    theta = np.arctan(r)
    bent = theta * (1 + sum(c * theta ** (2 * i + 2) for i, c in enumerate(k)))
    scale = np.where(r > 0, bent / np.maximum(r, 1e-12), 1.0)
    return x * scale, y * scale


def brown(x: Float64, y: Float64, d: tuple[float, ...]) -> tuple[Float64, Float64]:
    k1, k2, p1, p2, k3 = d
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


def looks(camera: CameraIntrinsics, u: Float64, v: Float64) -> tuple[Float64, Float64]:
    return (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy


@pytest.mark.parametrize("name", CAMERAS)
def test_rays_and_undistortion_undo_each_other(name: str) -> None:
    camera = CAMERAS[name]
    map_x, map_y = undistortion_maps(camera)
    u, v = np.meshgrid(np.arange(10.0, 150.0, 7), np.arange(10.0, 110.0, 7))
    x, y = looks(camera, u, v)
    columns, rows = (m[v.astype(int), u.astype(int)] for m in (map_x, map_y))
    back = cv2.remap(rays(camera).astype(np.float32), columns, rows, cv2.INTER_LINEAR)
    np.testing.assert_allclose(back, np.stack([x, y], axis=2), atol=2e-3)


@pytest.mark.parametrize("name", ["brown", "fisheye"])
def test_a_pixel_comes_from_where_the_formula_puts_it(name: str) -> None:
    camera = CAMERAS[name]
    u, v = np.meshgrid(np.arange(160.0), np.arange(120.0))
    formula = fisheye if name == "fisheye" else brown
    x, y = formula(*looks(camera, u, v), camera.distortion)
    map_x, map_y = undistortion_maps(camera)
    np.testing.assert_allclose(map_x, camera.fx * x + camera.cx, atol=1e-3)
    np.testing.assert_allclose(map_y, camera.fy * y + camera.cy, atol=1e-3)


def test_the_inverse_model_leads_from_the_distorted_point_to_the_pinhole() -> None:
    camera = CAMERAS["inverse"]
    u, v = np.meshgrid(np.arange(160.0), np.arange(120.0))
    x, y = brown(*looks(camera, u, v), camera.distortion)
    np.testing.assert_allclose(rays(camera), np.stack([x, y], axis=2), atol=1e-9)


@pytest.mark.parametrize("name", CAMERAS)
def test_a_straight_edge_is_straight_after_rectification(name: str) -> None:
    """A wall whose left half is dark: its edge, x = 0.3 z, is one column again."""
    camera = CAMERAS[name]
    directions = rays(camera)
    color = np.where(directions[..., 0] < 0.3, 40, 200).astype(np.uint8)
    depth = np.full(color.shape, 2.0, np.float32)
    straight = rectified(RgbdFrame(1, color, depth, camera))
    assert straight.intrinsics == PINHOLE
    edge = np.argmax(straight.color[10:110] > 120, axis=1)
    assert np.ptp(edge) <= 1
    assert abs(edge.mean() - (0.3 * PINHOLE.fx + PINHOLE.cx)) < 1.0
