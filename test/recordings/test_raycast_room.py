"""The ray-cast room is right where geometry says what is right."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from raycast_room import textures
from raycast_room.lighting import lit
from raycast_room.living_room import living_room
from raycast_room.maps import points_on
from raycast_room.motion import LOOP_S, hand_held
from raycast_room.raycaster import CYLINDER, SPHERE, Tables, nearest_hit, surface
from raycast_room.render import measure, render
from raycast_room.scene import Material, box, cylinder, faces_of, pack, room, sphere
from rigs.stored_room import stored_living_room

from rgbd_glue_ros.types import CameraIntrinsics, Float64

CAMERA = CameraIntrinsics(width=81, height=61, fx=70.0, fy=70.0, cx=40.0, cy=30.0)
WHITE = Material(textures.plain())
# the optical frame level at the origin, looking along the world's y
T_WORLD_CAMERA = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])

numbers = st.floats(-1, 1, allow_nan=False)
vectors = st.tuples(numbers, numbers, numbers)


@pytest.fixture(scope="module")
def scene() -> Tables:
    return living_room()


def test_the_room_that_tests_read_from_disk_is_the_one_that_is_made(scene: Tables) -> None:
    for name, stored, made in zip(Tables._fields, stored_living_room(), scene, strict=True):
        np.testing.assert_array_equal(stored, made, err_msg=name)


def _depth(scene: Tables) -> Float64:
    return measure(scene, T_WORLD_CAMERA, 0.0, CAMERA)[0]


def test_a_wall_across_the_view_has_one_depth() -> None:
    empty = pack([room((-5, -5, -5), (5, 2, 5), WHITE)])
    np.testing.assert_allclose(_depth(empty), 2.0, rtol=1e-12)


def test_a_sphere_has_the_depth_of_the_quadratic_equation() -> None:
    centre, radius = np.array([0.2, 3.0, -0.1]), 0.7
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    x, y = (u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy
    ray = np.stack([x, y, np.ones_like(x)], axis=-1)
    middle = T_WORLD_CAMERA[:3, :3].T @ centre
    a, b, c = (ray**2).sum(-1), ray @ middle, middle @ middle - radius**2
    with np.errstate(invalid="ignore"):
        expected = (b - np.sqrt(b**2 - a * c)) / a
    depth = _depth(pack([sphere((0.2, 3.0, -0.1), radius, WHITE)]))
    hit = np.isfinite(expected)
    assert hit.sum() > 100
    np.testing.assert_allclose(depth[hit], expected[hit], rtol=1e-9)
    assert (depth[~hit] > 1e20).all()


def test_a_turned_box_shows_its_edge_first() -> None:
    # turned by 45 degrees, its vertical edge is half a diagonal nearer than its centre
    depth = _depth(pack([box((0, 3, -1), (0.4, 0.4, 2.0), WHITE, yaw=45.0)]))
    assert depth[30, 40] == pytest.approx(3 - 0.2 * np.sqrt(2), abs=1e-9)
    assert depth[30].argmin() == 40


def test_a_cylinder_has_the_depth_of_its_circle() -> None:
    depth = _depth(pack([cylinder((0, 3, -1), 0.5, 2.0, WHITE)]))
    assert depth[30, 40] == pytest.approx(2.5)
    # a ray at the slope x meets the circle about (0, 3) of radius 0.5 in z (1, x)
    x = 5 / CAMERA.fx
    assert depth[30, 45] == pytest.approx((3 - np.sqrt(0.25 * (1 + x**2) - 9 * x**2)) / (1 + x**2))


@settings(deadline=None)  # the first call may compile
@given(vectors, vectors)
def test_the_hierarchy_finds_what_a_search_through_all_primitives_finds(
    scene: Tables, start: tuple[float, float, float], direction: tuple[float, float, float]
) -> None:
    assume(np.linalg.norm(direction) > 1e-3)
    origin = (1.6 * start[0], 1.6 * start[1], 1.2 + 1.1 * start[2])
    found = nearest_hit(scene, origin, direction, 1e30)[0]
    alone = np.inf
    for p in range(len(scene.shape)):
        leaf = scene._replace(
            bounds=np.array([[-1e9] * 3 + [1e9] * 3]), skip=np.array([1]), leaf=np.array([p])
        )
        alone = min(alone, nearest_hit(leaf, origin, direction, 1e30)[0])
    assert found == alone


@settings(deadline=None)
@given(st.sampled_from(["box", "sphere", "cylinder"]), st.data())
def test_a_point_of_a_face_is_found_again_by_its_map_coordinates(
    shape: str, data: st.DataObject
) -> None:
    primitive = {
        "box": box((0.3, -0.2, 0.1), (0.5, 0.8, 1.1), WHITE, yaw=33.0),
        "sphere": sphere((0.3, -0.2, 0.1), 0.4, WHITE),
        "cylinder": cylinder((0.3, -0.2, 0.1), 0.4, 1.1, WHITE),
    }[shape]
    tables = pack([primitive])
    face = data.draw(st.sampled_from(faces_of(primitive.shape)))
    inside = st.floats(0.01, 0.99)
    u, v = data.draw(inside), data.draw(inside)
    (point,), (normal,) = points_on(tables, 0, face, np.array([u]), np.array([v]))
    u_again, v_again, _, _, nx, ny, nz = surface(tables, 0, face, tuple(point))
    assert (u_again, v_again) == (pytest.approx(u, abs=1e-9), pytest.approx(v, abs=1e-9))
    np.testing.assert_allclose((nx, ny, nz), normal, atol=1e-9)
    if primitive.shape in (SPHERE, CYLINDER) and face == 0:
        across = point - tables.centre[0]
        if primitive.shape == CYLINDER:
            across[2] = 0.0
        assert np.linalg.norm(across) == pytest.approx(0.4)


def test_what_the_projector_does_not_see_sends_no_echo() -> None:
    post = box((0, 1.0, -1), (0.2, 0.02, 2.0), WHITE)
    scene = pack([room((-5, -5, -5), (5, 2, 5), WHITE), post])
    baseline = 0.1
    depth, echo = measure(scene, T_WORLD_CAMERA, baseline, CAMERA)
    dark = np.flatnonzero(echo[30] == 0)
    # by similar triangles, the projector's ray past the post's left edge, at x = -0.1 in depth 1,
    # meets the wall in depth 2 at this x; from there to the post itself the wall is dark
    x = baseline + 2 * (-0.1 - baseline)
    assert dark.min() == pytest.approx(CAMERA.cx + CAMERA.fx * x / 2, abs=1.5)
    assert dark.max() == pytest.approx(CAMERA.cx + CAMERA.fx * -0.1, abs=1.5)
    assert (depth[30, dark] > 1.9).all()


def test_light_falls_off_with_the_square_of_the_distance_and_with_the_cosines() -> None:
    # a small lamp on the ceiling of a large black room, over the middle of the floor
    black = Material(textures.plain(), (0, 0, 0))
    lamp = Material(textures.plain(), emission=100.0)
    high, half = 2.0, 0.05
    scene = lit(
        pack(
            [
                room((-2, -2, 0), (2, 2, high), black),
                box((0, 0, high - 0.01), (2 * half, 2 * half, 0.01), *[black] * 4, lamp, black),
            ]
        )
    )
    first, across, down = scene.lightmap[0, 4]
    floor = scene.light[first : first + across * down, 0].reshape(down, across)
    x = np.linspace(-2, 2, across)
    square = x[None] ** 2 + x[:, None] ** 2 + (high - 0.01) ** 2
    expected = 100.0 * (2 * half) ** 2 / np.pi * (high - 0.01) ** 2 / square**2
    np.testing.assert_allclose(floor[2:-2, 2:-2], expected[2:-2, 2:-2], rtol=0.02)


def test_the_room_is_lit_and_its_table_throws_a_shadow(scene: Tables) -> None:
    pose = hand_held(1.5).matrix
    color, depth = render(scene, pose, CAMERA)
    assert color.shape == (CAMERA.height, CAMERA.width, 3)
    assert depth.dtype == np.float32
    assert 1.0 < depth.min() < depth.max() < 4.5
    assert 60 < color.mean() < 180
    first, across, down = scene.lightmap[0, 4]
    floor = scene.light[first : first + across * down].mean(axis=1).reshape(down, across)
    low, size = scene.centre[0] - scene.half[0], 2 * scene.half[0]

    def light_on_floor(x: float, y: float) -> float:
        column = round((x - low[0]) / size[0] * (across - 1))
        row = round((1 - (y - low[1]) / size[1]) * (down - 1))
        return float(floor[row, column])

    assert light_on_floor(0.12, 0.62) < 0.5 * light_on_floor(0.1, -0.6)


def test_the_hand_carries_the_camera_smoothly_and_back_to_where_it_began() -> None:
    rate = 200
    poses = np.array([hand_held(k / rate).matrix for k in range(round(LOOP_S * rate) + 1)])
    np.testing.assert_allclose(poses[0], poses[-1], atol=1e-9)
    R = poses[:, :3, :3]
    np.testing.assert_allclose(
        R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-14
    )
    velocity = np.diff(poses[:, :3, 3], axis=0) * rate
    speed = np.linalg.norm(velocity, axis=1)
    assert 0.3 < speed.mean() < 0.5
    assert speed.max() < 0.8
    assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() * rate < 20  # m/s^2
