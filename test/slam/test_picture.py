"""A picture of a cloud shows points where they are seen, and all of them."""

from __future__ import annotations

import numpy as np
import pytest

from rgbd_glue_ros.slam.cloud import ColoredCloud
from rgbd_glue_ros.slam.picture import (
    CAMERA_RGB,
    PAGE,
    PATH_RGB,
    Onlooker,
    picture,
    with_path,
)
from rgbd_glue_ros.types import Float64, UInt8

WIDTH, HEIGHT = 200, 120
RED, GREEN = (255, 0, 0), (0, 255, 0)
AHEAD = Onlooker.at(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0]), 200, 120)


def cloud(points: object, *colors: tuple[int, int, int]) -> ColoredCloud:
    return ColoredCloud(np.array(points, np.float32), np.array(colors, np.uint8))


def shown(image: UInt8, rgb: tuple[int, int, int]) -> Float64:
    """The middle of what has a colour, pixels u and v."""
    v, u = np.nonzero((image == rgb).all(axis=2))
    return np.array([u.mean(), v.mean()])


def test_a_point_is_where_a_pinhole_has_it_and_large_as_it_is_near() -> None:
    image = picture(cloud([[0.5, -0.2, 2.0], [-0.5, 0.2, 1.0]], RED, GREEN), AHEAD)
    focal = 0.95 * WIDTH
    # a square of 2 n pixels ends before the middle's right and lower neighbour
    expected = [WIDTH / 2 + focal * 0.25, HEIGHT / 2 - focal * 0.1]
    np.testing.assert_allclose(shown(image, RED), expected, atol=1.5)
    expected = [WIDTH / 2 - focal * 0.5, HEIGHT / 2 + focal * 0.2]
    np.testing.assert_allclose(shown(image, GREEN), expected, atol=1.5)
    sizes = [(image == rgb).all(axis=2).sum() for rgb in (RED, GREEN)]
    assert sizes[0] < sizes[1]
    assert (image[0, 0] == PAGE).all()


def test_what_is_near_covers_what_is_far_in_whatever_order_and_nothing_behind_is_seen() -> None:
    near, far, behind = [0.0, 0.0, 1.0], [0.0, 0.0, 2.0], [0.0, 0.0, -1.0]
    for points, colors in (([near, far], (RED, GREEN)), ([far, near], (GREEN, RED))):
        image = picture(cloud(points, *colors), AHEAD)
        assert (image[HEIGHT // 2, WIDTH // 2] == RED).all()
    assert (picture(cloud([behind], RED), AHEAD) == PAGE).all()


@pytest.mark.parametrize("distance", [0.0, 0.5, 3.0])
def test_an_onlooker_of_a_map_sees_most_of_it_upright(distance: float) -> None:
    """Cameras that look along z from so far away, and from inside."""
    rng = np.random.default_rng(0)
    points = rng.uniform([-2, -1, 0], [2, 1, 3], (2000, 3)).astype(np.float32)
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, :3, 3] = [0, 0, 1.5 - distance]
    poses[:, 0, 3] = np.linspace(-0.5, 0.5, 5)
    box = ColoredCloud(points, np.zeros((2000, 3), np.uint8))
    onlooker = Onlooker.of(box, poses, WIDTH, HEIGHT)
    uv, z = onlooker.sees(points.astype(np.float64))
    inside = (z > 0) & (uv > 0).all(axis=1) & (uv < [WIDTH, HEIGHT]).all(axis=1)
    assert inside.mean() > 0.85
    # y is down, and the top of the box is at the top of the picture
    (top, bottom), _ = onlooker.sees(np.array([[0.0, -1.0, 1.5], [0.0, 1.0, 1.5]]))
    assert top[1] < bottom[1]


def test_the_way_is_a_line_that_ends_in_a_camera_and_is_not_drawn_behind_the_eye() -> None:
    page = picture(cloud([[0.0, 0.0, 1.0]], RED), AHEAD)
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = [[-0.4, 0.1, 2.0], [0.4, 0.1, 2.0], [0.4, -0.1, 2.0]]
    drawn = with_path(page, poses, AHEAD, 3)
    assert (drawn == PATH_RGB).all(axis=2).sum() > 50
    assert (drawn == CAMERA_RGB).all(axis=2).sum() > 5
    assert (page != PATH_RGB).any(axis=2).all()  # the picture itself is as it was
    poses[:, 2, 3] = -1.0
    np.testing.assert_array_equal(with_path(page, poses, AHEAD, 3), page)
