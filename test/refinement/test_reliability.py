"""The information that errors of normals and gradients make up is told from what is real."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.room import room_view, true_pose
from rigs.scenes import SCENES

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.gauss_newton import Refinement, evaluate_pose
from rgbd_glue_ros.refinement.model import Model, model_of
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.reliability import ExpectedPose, without_spurious_information
from rgbd_glue_ros.types import Float64, View

CONFIG = Config().refine
REACH = 0.03
CORRIDOR = SCENES["an empty corridor at 10 Hz"]
WHERE_IT_WAS = ExpectedPose(np.eye(4), 1e-8 * np.eye(6))


def corridor_views(seed: int) -> tuple[View, View]:
    """The first two frames of an empty corridor."""
    frames, camera = CORRIDOR.noisy_frames(seed), Config().camera
    return view_of(next(frames), camera), view_of(next(frames), camera)


def evaluated(
    model: Model,
    now: View,
    T: Float64,
    reach: float = REACH,
    expected: ExpectedPose = WHERE_IT_WAS,
) -> tuple[Refinement, Refinement]:
    """A pose with spurious information and without it."""
    problem = RefinementProblem(model, now, CONFIG)
    pose = evaluate_pose(T, problem)
    return pose, without_spurious_information(pose, expected, problem, reach)


def test_a_pose_that_the_images_determine_is_left_unchanged() -> None:
    truth = se3.inverse(true_pose(0.0)) @ true_pose(0.3)
    pose, left = evaluated(model_of(room_view(0.0), CONFIG.grid_step), room_view(0.3), truth)
    assert left is pose


def test_with_no_distance_to_compare_over_a_pose_is_left_unchanged() -> None:
    before, now = corridor_views(seed=0)
    pose, left = evaluated(model_of(before, CONFIG.grid_step), now, np.eye(4), reach=0.0)
    assert left is pose


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_in_an_empty_corridor_no_information_is_left_along_it_and_all_of_it_across(
    seed: int,
) -> None:
    before, now = corridor_views(seed)
    wrong = CORRIDOR.true_poses()[1] @ se3.exp(np.array([0.0, 0.0, -0.2, 0.0, 0.0, 0.0]))
    pose, left = evaluated(model_of(before, CONFIG.grid_step), now, wrong)
    information, left_of_it = np.diag(pose.information), np.diag(left.information)
    # the camera looks along z
    assert information[2] > 5000
    assert np.linalg.eigvalsh(left.information)[0] < 1e-6 * np.linalg.eigvalsh(pose.information)[0]
    assert (left_of_it[[0, 1, 3, 4, 5]] > 0.9 * information[[0, 1, 3, 4, 5]]).all()
    # nor does the pose know of the way along it: it is back where it was expected
    assert abs(left.T_model_source[2, 3]) < 0.02


def test_information_is_removed_in_the_direction_in_which_the_pose_is_uncertain_already() -> None:
    """Noise tilts the weakest direction in every frame, which would add up to a measurement."""
    before, now = corridor_views(seed=0)
    wrong = CORRIDOR.true_poses()[1] @ se3.exp(np.array([0.0, 0.0, -0.2, 0.0, 0.0, 0.0]))
    uncertain = np.array([0.03, 0.0, 1.0, 0.0, 0.02, 0.0])
    uncertain /= np.linalg.norm(uncertain)
    for metres, is_taken in ((0.2, True), (0.01, False)):
        covariance = 1e-8 * np.eye(6) + metres**2 * np.outer(uncertain, uncertain)
        expected = ExpectedPose(np.eye(4), covariance)
        pose, left = evaluated(model_of(before, CONFIG.grid_step), now, wrong, expected=expected)
        in_camera = se3.adjoint(left.T_model_source) @ uncertain
        known, known_before = (in_camera @ p.information @ in_camera for p in (left, pose))
        assert (known < 1e-6 * known_before) == is_taken


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_of_two_edges_that_are_parallel_pixels_measure_four_directions(seed: int) -> None:
    """A line in an image has two parameters: its angle and its distance from the centre."""
    before, now = corridor_views(seed)
    model = model_of(before, CONFIG.grid_step)
    pixels = [np.ones(len(level.points), bool) for level in model.pixels]
    alone = model.selected(np.zeros(len(model.planes.points), bool), pixels)
    pose, left = evaluated(alone, now, CORRIDOR.true_poses()[1])
    known, known_after = (np.linalg.eigvalsh(p.information) for p in (pose, left))
    assert known[0] > 1000
    assert (known_after[:2] < 1e-6 * known[:2]).all()
    assert (known_after[2:] > 0.5 * known[2:]).all()


@pytest.mark.parametrize(
    ("place", "directions"),
    [("a bare wall", 3), ("a bare floor", 3), ("the edge of a bare wall", 1)],
)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_of_bare_surfaces_no_information_is_left_in_directions_along_all_of_them(
    place: str, directions: int, seed: int
) -> None:
    scene = SCENES[place]
    frames = scene.noisy_frames(seed)
    before, now = (view_of(next(frames), Config().camera) for _ in range(2))
    model = model_of(before, CONFIG.grid_step)
    pose, left = evaluated(model, now, scene.true_poses()[1])
    known, known_after = (np.linalg.eigvalsh(p.information) for p in (pose, left))
    assert (known_after[:directions] < 1e-6 * known[:directions]).all()
    assert (known_after[directions:] > 0.5 * known[directions:]).all()


def test_in_the_dark_a_direction_is_kept_in_which_enough_is_real_however_much_noise_there_is() -> (
    None
):
    """Of three directions with less than a third in common, one has more than a pose needs."""
    rng = np.random.default_rng(0)
    before, now = (in_the_dark(room_view(seconds), rng) for seconds in (0.0, 0.1))
    model = model_of(before, CONFIG.grid_step)
    pixels = [np.ones(len(level.points), bool) for level in model.pixels]
    alone = model.selected(np.zeros(len(model.planes.points), bool), pixels)
    pose, left = evaluated(alone, now, se3.inverse(true_pose(0.0)) @ true_pose(0.1))
    known, known_after = (np.linalg.eigvalsh(p.information) for p in (pose, left))
    assert (known_after < 1e-6 * known[0]).sum() == 2


def in_the_dark(view: View, rng: np.random.Generator) -> View:
    """A view with a twelfth of the light, noise, and limits of grey levels that suit it."""
    noisy = 0.08 * view.grey + rng.normal(0, 3.0, view.grey.shape)
    return replace(view, grey=np.clip(noisy, 0, 255).round().astype(np.uint8), contrast=0.2)


def test_information_that_nothing_can_be_compared_with_is_kept() -> None:
    """A patch of nine depths is on no plane: what it would say is not known to be spurious."""
    before, now = corridor_views(seed=0)
    stripes = np.where(np.arange(now.depth.shape[0])[:, np.newaxis] % 4 < 2, now.depth, np.nan)
    striped = replace(now, depth=stripes.astype(np.float32), grey=np.zeros_like(now.grey))
    pose, left = evaluated(model_of(before, CONFIG.grid_step), striped, np.eye(4))
    np.testing.assert_array_equal(left.information, pose.information)
