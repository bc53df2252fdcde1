"""The tree of frames, against closed forms."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from hypothesis import given
from rigs.geometry import SEEDS, random_transform

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages.transform_tree import HISTORY_NS, MOST_FRAMES, TransformTree
from rgbd_glue_ros.types import NANOSECONDS, Float64

SECOND = NANOSECONDS


def found(tree: TransformTree, target: str, source: str, stamp_ns: int | None) -> Float64:
    T = tree.lookup(target, source, stamp_ns, 0)
    assert T is not None
    return T


@given(SEEDS)
def test_frames_of_two_branches_are_related_through_their_common_ancestor(seed: int) -> None:
    rng = np.random.default_rng(seed)
    base_camera, camera_optical, base_laser = (random_transform(rng) for _ in range(3))
    tree = TransformTree()
    tree.add("base", "camera", base_camera, None)
    tree.add("camera", "optical", camera_optical, None)
    tree.add("base", "laser", base_laser, None)
    expected = se3.inverse(base_laser) @ base_camera @ camera_optical
    np.testing.assert_allclose(found(tree, "laser", "optical", None), expected, atol=1e-9)
    np.testing.assert_allclose(found(tree, "base", "base", None), np.eye(4))


def moved(seconds: float) -> Float64:
    """A robot that drives a circle: v = 1 m/s, 0.5 rad/s."""
    return se3.exp(np.array([1.0, 0, 0, 0, 0, 0.5]) * seconds)


def test_between_known_poses_a_body_moves_at_constant_velocity() -> None:
    tree = TransformTree()
    for time_s in (0.3, 0.0, 1.0, 2.0):  # not quite in order
        tree.add("odom", "base", moved(time_s), round(time_s * SECOND))
    for time_s in (0.0, 0.1, 1.0, 1.75, 2.0):
        T = found(tree, "odom", "base", round(time_s * SECOND))
        np.testing.assert_allclose(T, moved(time_s), atol=1e-9)


def test_nothing_is_extrapolated_and_without_a_stamp_the_newest_is_returned() -> None:
    tree = TransformTree()
    tree.add("odom", "base", moved(1), 1 * SECOND)
    assert tree.lookup("odom", "base", SECOND + 1, 0) is None
    assert tree.lookup("odom", "base", SECOND - 1, 0) is None
    np.testing.assert_array_equal(tree.lookup("odom", "base", None, 0), moved(1))


@pytest.mark.parametrize(("target", "source"), [("base", "moon"), ("moon", "base"), ("a", "b")])
def test_unrelated_frames_have_no_transform(target: str, source: str) -> None:
    tree = TransformTree()
    tree.add("odom", "base", np.eye(4), None)
    tree.add("b", "c", np.eye(4), None)
    assert tree.lookup(target, source, None, 0) is None


def test_a_cycle_of_frames_does_no_harm() -> None:
    tree = TransformTree()
    tree.add("a", "b", moved(1), None)
    tree.add("b", "a", moved(1), None)
    assert tree.lookup("a", "b", None, 0) is not None
    assert tree.lookup("c", "a", None, 0) is None


def test_a_waiting_lookup_gets_the_transform_when_it_arrives() -> None:
    tree = TransformTree()
    timer = threading.Timer(0.05, tree.add, ["odom", "base", moved(1), None])
    timer.start()
    np.testing.assert_array_equal(tree.lookup("odom", "base", None, 10), moved(1))
    timer.join()


def test_when_time_restarts_old_poses_are_forgotten() -> None:
    tree = TransformTree()
    tree.add("odom", "base", moved(1), 3 * SECOND)
    tree.add("odom", "base", moved(2), SECOND)
    assert tree.lookup("odom", "base", 3 * SECOND, 0) is None
    np.testing.assert_array_equal(tree.lookup("odom", "base", SECOND, 0), moved(2))


def test_transforms_older_than_the_history_are_forgotten() -> None:
    tree = TransformTree()
    period = HISTORY_NS // 50
    for i in range(200):
        tree.add("odom", "base", moved(i), i * period)
    assert tree.lookup("odom", "base", 140 * period, 0) is None
    assert tree.lookup("odom", "base", 150 * period, 0) is not None


def test_endless_new_frame_names_do_not_fill_the_memory_and_known_ones_stay() -> None:
    tree = TransformTree()
    tree.add("base", "camera", moved(1.0), None)
    for i in range(MOST_FRAMES + 10):
        tree.add("base", f"frame_{i}", np.eye(4), None)
    assert tree.lookup("base", f"frame_{MOST_FRAMES}", None, 0) is None
    tree.add("base", "camera", moved(2.0), None)
    np.testing.assert_allclose(found(tree, "base", "camera", None), moved(2.0))
