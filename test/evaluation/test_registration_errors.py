"""Errors of registrations: closed forms, and chamfer distances that brute force finds too."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rigs.geometry import SEEDS, random_transform, room_points, transforms
from scipy.spatial.distance import cdist

from rgbd_glue_ros.evaluation.registration_errors import (
    RegistrationErrors,
    chamfer,
    chamfer_points,
    error_statistics,
    registration_errors,
    rotation_deg,
    translation_cm,
)
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import CameraIntrinsics, Float64, View

CAMERA = CameraIntrinsics(640, 480, 500.0, 500.0, 319.5, 239.5)
WALL_M = 2.0


def wall() -> View:
    """A wall across the whole image, of which a corner is not known."""
    depth = np.full((480, 640), WALL_M, np.float32)
    depth[:240, :320] = np.nan
    return View(np.zeros(depth.shape, np.uint8), depth, CAMERA)


def translation(*t: float) -> Float64:
    return se3.from_rotation_translation(np.eye(3), np.array(t))


def errors(rotation_deg: float, *, failed: bool = False) -> RegistrationErrors:
    return RegistrationErrors(rotation_deg, 0.0, 0.0, failed)


@given(transforms(), st.floats(0.01, 3.0), st.floats(0.01, 3.0))
def test_an_estimate_is_as_wrong_as_it_was_made(truth: Float64, angle: float, way: float) -> None:
    axis = np.array([0.6, 0.0, 0.8])
    # turned about the source's own origin, which leaves the translation as it is
    turned = truth @ se3.exp(np.concatenate([np.zeros(3), angle * axis]))
    assert rotation_deg(turned, truth) == pytest.approx(np.rad2deg(angle), rel=1e-6)
    assert translation_cm(turned, truth) == pytest.approx(0, abs=1e-9)
    moved = translation(*way * axis) @ truth
    assert rotation_deg(moved, truth) == pytest.approx(0, abs=1e-5)
    assert translation_cm(moved, truth) == pytest.approx(100 * way, rel=1e-6)


def test_the_truth_has_no_error() -> None:
    truth = random_transform(np.random.default_rng(0))
    found = registration_errors(truth, truth, wall(), wall())
    assert found.rotation_deg == pytest.approx(0, abs=1e-5)
    assert found.translation_cm == found.chamfer_mm == 0
    assert not found.failed


def test_without_a_transform_the_errors_are_those_of_the_identity() -> None:
    truth = random_transform(np.random.default_rng(1))
    none = registration_errors(None, truth, wall(), wall())
    identity = registration_errors(np.eye(4), truth, wall(), wall())
    assert none.failed
    assert (none.rotation_deg, none.translation_cm, none.chamfer_mm) == (
        identity.rotation_deg,
        identity.translation_cm,
        identity.chamfer_mm,
    )


def test_the_chamfer_distance_of_two_points_of_which_one_is_misplaced() -> None:
    # either scene has a point that the other has too, and one 3 cm off: (0 + 9) / 2 cm², twice
    source, target = np.array([[0.0, 0.0, 1.0]]), np.array([[5.0, 0.0, 1.0]])
    distance = chamfer(translation(0.03, 0, 0), np.eye(4), source, target)
    assert distance == pytest.approx(9e-4)


@given(SEEDS)
def test_the_chamfer_distance_is_that_of_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source, target = room_points(rng, 30), room_points(rng, 20)
    truth, estimate = random_transform(rng), random_transform(rng)
    scenes = [
        np.concatenate([source, se3.transform(se3.inverse(T), target)]) for T in (estimate, truth)
    ]
    squared = cdist(*scenes, "sqeuclidean")
    expected = squared.min(axis=0).mean() + squared.min(axis=1).mean()
    assert chamfer(estimate, truth, source, target) == pytest.approx(expected)


@given(SEEDS)
def test_the_chamfer_distance_does_not_tell_the_estimate_from_the_truth(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source, target = room_points(rng, 10), room_points(rng, 10)
    first, second = random_transform(rng), random_transform(rng)
    there, back = chamfer(first, second, source, target), chamfer(second, first, source, target)
    assert there == pytest.approx(back)


def test_frames_without_a_point_differ_in_nothing() -> None:
    nothing = np.empty((0, 3))
    truth = random_transform(np.random.default_rng(0))
    assert chamfer(np.eye(4), truth, nothing, nothing) == 0.0
    assert chamfer(np.eye(4), truth, room_points(np.random.default_rng(0), 5), nothing) == 0.0


def test_the_chamfer_points_are_128_by_128_of_the_centred_square_where_depth_is_known() -> None:
    points = chamfer_points(wall())
    assert len(points) == 128 * 128 * 3 // 4
    np.testing.assert_allclose(points[:, 2], WALL_M)
    u = points[:, 0] / WALL_M * CAMERA.fx + CAMERA.cx
    v = points[:, 1] / WALL_M * CAMERA.fy + CAMERA.cy
    # 480 pixels in 128 steps of 3.75, the first at the left of the square and at the top
    np.testing.assert_allclose(np.unique(u.round(6)), 80 + np.arange(128) * 480 // 128)
    np.testing.assert_allclose(np.unique(v.round(6)), np.arange(128) * 480 // 128)


def test_accuracy_is_the_part_up_to_each_threshold() -> None:
    statistics = error_statistics([errors(1.0), errors(5.0), errors(7.0), errors(50.0)])
    rotation = statistics["rotation_deg"]
    assert rotation["accuracy"] == {"5": 50.0, "10": 75.0, "45": 75.0}
    assert rotation["mean"] == pytest.approx(15.75)
    assert rotation["median"] == pytest.approx(6.0)
    assert {name: list(s["accuracy"]) for name, s in statistics.items()} == {
        "rotation_deg": ["5", "10", "45"],
        "translation_cm": ["5", "10", "25"],
        "chamfer_mm": ["1", "5", "10"],
    }


def test_a_failed_registration_is_accurate_at_no_threshold_but_counts_in_the_mean() -> None:
    rotation = error_statistics([errors(1.0), errors(3.0, failed=True)])["rotation_deg"]
    assert rotation["accuracy"] == {"5": 50.0, "10": 50.0, "45": 50.0}
    assert rotation["mean"] == pytest.approx(2.0)
