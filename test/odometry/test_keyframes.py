"""Keyframes: the window of the latest, numbered for good, and anchors that know the room."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rigs.geometry import random_transform, transforms
from rigs.room import CAMERA

from rgbd_glue_ros.features.lifting import KeypointPoints
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.keyframe import Anchor, NewestKeyframe
from rgbd_glue_ros.odometry.keyframes import Keyframes
from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.refinement.model import LEVELS, Model, Pixels, Planes
from rgbd_glue_ros.registration.frame_features import FrameFeatures, KeypointFeatures
from rgbd_glue_ros.types import Float64, View

VIEW = View(np.zeros((2, 2), np.uint8), np.ones((2, 2), np.float32), CAMERA)
FEATURES = FrameFeatures(VIEW, None, None, {})
NO_POINTS = KeypointPoints.of(np.empty((0, 2), np.float32), VIEW)
POINTS = np.array([[0.0, 0, 2], [1, 0, 3]])
NORMALS = np.array([[0.0, 0, -1], [-0.6, 0, -0.8]])
STILL, MIDDLE_ROW = np.zeros((2, 3)), np.zeros(2)
MODEL = Model(
    Planes(points=POINTS, normals=NORMALS, velocity=STILL, row_time=MIDDLE_ROW),
    (Pixels(points=POINTS, brightness=np.array([10.0, 20.0]), velocity=STILL, row_time=MIDDLE_ROW),)
    * LEVELS,
)


def kept(capacity: int, window: int = 5, spacing: float = 0.0) -> Keyframes:
    config = OdometryConfig(keyframes=capacity, window=window, keyframe_spacing=spacing)
    return Keyframes(config, lambda features: KeypointFeatures(features.visual, None, NO_POINTS))


def add(
    keyframes: Keyframes,
    T: Float64,
    stamp_ns: int = 0,
    T_odom_track: Float64 | None = None,
    component: int | None = 0,
    sigma: float = 1.0,
) -> NewestKeyframe:
    T_odom_track = np.eye(4) if T_odom_track is None else T_odom_track
    covariance = sigma**2 * np.eye(6)
    return keyframes.add(stamp_ns, T, covariance, FEATURES, MODEL, T_odom_track, component)


def moved(metres: float, radians: float = 0.0) -> Float64:
    return se3.exp(np.array([metres, 0, 0, 0, radians, 0]))


@given(st.integers(1, 5), st.integers(0, 12))
def test_the_number_of_keyframes_is_limited_and_the_oldest_are_removed(
    capacity: int, n: int
) -> None:
    keyframes = kept(capacity)
    for i in range(n):
        assert add(keyframes, np.eye(4), stamp_ns=i).number == i
    assert len(keyframes) == min(n, capacity)
    assert [k.stamp_ns for k in keyframes] == list(range(n))[-capacity:]


@pytest.mark.parametrize("window", [1, 2, 5])
def test_only_the_newest_keyframe_keeps_its_images(window: int) -> None:
    keyframes = kept(capacity=10, window=window)
    for metres in range(5):
        add(keyframes, moved(metres))
    with_images = [k.number for k in keyframes if isinstance(k.features, FrameFeatures)]
    assert with_images == [4]
    assert len(keyframes) == 5


def test_keyframes_outside_the_window_are_used_for_relocalisation_but_not_for_tracking() -> None:
    keyframes = kept(3)
    for metres in (0.0, 5.0):
        add(keyframes, moved(metres))
    keyframes.leave_window(np.eye(4))
    assert keyframes.nearest(np.eye(4), keyframes.component, 1) == []
    assert [k.number for k in keyframes.latest(3)] == [1, 0]
    assert add(keyframes, np.eye(4)).number == 2


@given(transforms())
def test_a_keyframe_has_its_model_in_the_track_frame(T: Float64) -> None:
    model = add(kept(1), T).model
    np.testing.assert_allclose(
        se3.transform(se3.inverse(T), model.planes.points), POINTS, atol=1e-9
    )
    np.testing.assert_allclose(model.planes.normals @ T[:3, :3], NORMALS, atol=1e-9)
    for pixels in model.pixels:
        np.testing.assert_allclose(pixels.points, model.planes.points)
        np.testing.assert_array_equal(pixels.brightness, [10, 20])


@pytest.mark.parametrize(
    ("poses", "order"),
    [
        ([moved(0.5), moved(0.1), moved(-0.3)], [1, 2, 0]),
        # turned by half a radian is as different as half a metre aside
        ([moved(0.0, 0.5), moved(0.4), moved(0.6)], [1, 0, 2]),
        # of equals the newer, which has drifted less since
        ([moved(1.0), moved(1.0)], [1, 0]),
    ],
    ids=["aside", "turned", "equal"],
)
def test_keyframes_with_the_most_similar_pose_come_first(
    poses: list[Float64], order: list[int]
) -> None:
    T = random_transform(np.random.default_rng(0))
    keyframes = kept(5)
    for pose in poses:
        add(keyframes, T @ pose)
    assert [k.number for k in keyframes.nearest(T, keyframes.component, len(keyframes))] == order


def test_tracking_does_not_return_to_keyframes_older_than_the_window() -> None:
    keyframes = kept(5, window=2)
    for way in (0.0, 0.5, 1.0):
        add(keyframes, moved(way))
    assert [
        k.number for k in keyframes.nearest(np.eye(4), keyframes.component, len(keyframes))
    ] == [1, 2]
    assert [k.number for k in keyframes.latest(2)] == [2, 1]


@given(n=st.integers(0, 9), count=st.integers(0, 4))
def test_relocalisation_tries_the_newest_keyframes_first_and_then_all_others(
    n: int, count: int
) -> None:
    keyframes = kept(9)
    for _ in range(n):
        add(keyframes, np.eye(4))
    assert [k.number for k in keyframes.in_turn(count, 0)] == list(range(n))[::-1][:count]
    turns = [k.number for turn in range(9) for k in keyframes.in_turn(count, turn)]
    assert set(turns) == (set(range(n)) if count else set())


def test_a_keyframe_that_leaves_the_window_becomes_an_anchor_at_its_drift_free_pose() -> None:
    keyframes = kept(5, window=1)
    first = add(keyframes, moved(0.0), T_odom_track=moved(9.0))
    assert not keyframes.anchors(moved(0.2), radius=1.0)
    add(keyframes, moved(0.5), T_odom_track=moved(0.2))
    (anchor,) = keyframes.anchors(moved(0.2), radius=0.01)
    assert isinstance(anchor, Anchor)
    assert anchor.number == first.number
    np.testing.assert_array_equal(anchor.T_track_camera, first.T_track_camera)
    np.testing.assert_allclose(anchor.T_odom_camera, moved(0.2))


def test_anchors_that_are_near_enough_are_used_earliest_first() -> None:
    keyframes = kept(9, window=1)
    for way in (0.0, 0.4, 0.8, 1.2):
        add(keyframes, moved(way))
    expected: tuple[tuple[float, float, list[int]], ...] = (
        (0.8, 0.1, [2]),
        (0.8, 0.5, [1, 2]),
        (0.8, 0.9, [0, 1, 2]),
        (-1.0, 0.9, []),
    )
    for where, radius, numbers in expected:
        assert [a.number for a in keyframes.anchors(moved(where), radius)] == numbers


def test_of_keyframes_with_the_same_view_the_first_stays_as_an_anchor() -> None:
    keyframes = kept(9, window=1, spacing=0.5)
    for way in (0.0, 0.4, 0.8, 0.1, 1.5):
        add(keyframes, moved(way))
    assert [k.number for k in keyframes] == [0, 2, 4]


def test_at_the_limit_the_oldest_anchor_is_removed_and_the_window_stays() -> None:
    keyframes = kept(4, window=3)
    for i in range(8):
        add(keyframes, moved(float(i)))
    assert [k.number for k in keyframes] == [4, 5, 6, 7]
    assert [
        k.number for k in keyframes.nearest(moved(9.0), keyframes.component, len(keyframes))
    ] == [7, 6, 5]


def test_frames_are_compared_with_the_component_of_the_newest_keyframe_alone() -> None:
    keyframes = kept(9)
    add(keyframes, moved(0.0))
    first = add(keyframes, moved(0.1), component=None)
    second = add(keyframes, moved(0.2), component=first.component)
    assert first.component == first.number
    assert [
        k.number for k in keyframes.nearest(moved(0.0), keyframes.component, len(keyframes))
    ] == [
        first.number,
        second.number,
    ]
    assert [k.number for k in keyframes.of_earlier_components()] == [0]
    assert keyframes.is_tracked_from(first)
    assert not keyframes.is_tracked_from(keyframes.of_earlier_components()[0])


@given(transforms())
def test_a_component_that_joins_another_moves_there_as_a_whole(T_shift: Float64) -> None:
    keyframes = kept(9, window=2)
    known = add(keyframes, moved(0.0), sigma=0.1)
    for way, sigma in ((1.0, 2.0), (2.0, 2.1)):
        component = keyframes.component if way > 1 else None
        newest = add(keyframes, moved(way), component=component, sigma=sigma)
    before = {k.number: k for k in keyframes}
    covariance, T_odom_track = 0.2**2 * np.eye(6), moved(5.0)
    joined = keyframes.join(newest, known.component, T_shift, covariance, T_odom_track)
    after = {k.number: k for k in keyframes}
    assert {k.component for k in after.values()} == {known.component}
    assert after[0] is before[0]
    for number in (1, 2):
        T = T_shift @ before[number].T_track_camera
        np.testing.assert_allclose(after[number].T_track_camera, T)
        points = se3.transform(T, POINTS)
        np.testing.assert_allclose(after[number].model.planes.points, points, atol=1e-9)
    np.testing.assert_array_equal(joined.covariance, covariance)
    # the other is as uncertain as before relative to the newest, and not by metres any more
    assert np.linalg.eigvalsh(after[1].covariance)[0] > 0.2**2
    assert np.trace(after[1].covariance) < np.trace(before[1].covariance)


def test_an_anchor_that_joins_a_component_has_its_drift() -> None:
    keyframes = kept(9, window=1)
    known = add(keyframes, moved(0.0))
    add(keyframes, moved(3.0), component=None)
    newest = add(keyframes, moved(6.0), component=1)
    keyframes.join(newest, known.component, moved(1.0), np.eye(6), moved(5.0))
    (first, second) = (k for k in keyframes if isinstance(k, Anchor))
    np.testing.assert_array_equal(first.T_odom_track, np.eye(4))
    np.testing.assert_allclose(second.T_odom_camera, moved(5.0 + 1.0 + 3.0))
