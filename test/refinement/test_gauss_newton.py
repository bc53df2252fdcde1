"""Refinement ends at the true pose, by planes, by pixels and by both, or tells that it did not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from rigs.geometry import SEEDS
from rigs.room import CAMERA, TIMES, room_view, true_depth, true_pose
from rigs.unseen import without_depth

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import project
from rgbd_glue_ros.parameters import RefineConfig
from rgbd_glue_ros.refinement.gauss_newton import Refinement, evaluate_pose, refine
from rgbd_glue_ros.refinement.model import LEVELS, LastBlend, Model, Pixels, Planes, blend, model_of
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.types import Float64, UInt8, View

STEP = 8
# enough to converge from anywhere that a motion prior or the fit may be off
CONFIG = RefineConfig(iterations=15)


def true_transform() -> Float64:
    """T_model_source."""
    return se3.inverse(true_pose(TIMES[0])) @ true_pose(TIMES[1])


def the_model() -> Model:
    return model_of(room_view(TIMES[0]), STEP)


def the_source() -> View:
    return room_view(TIMES[1])


def the_problem(
    source: View | None = None, model: Model | None = None, config: RefineConfig = CONFIG
) -> RefinementProblem:
    """That of the source on the model, or of others."""
    return RefinementProblem(model or the_model(), source or the_source(), config)


def perturbed(seed: int, metres: float = 0.03, radians: float = 0.02) -> Float64:
    """The truth, off by so much about and along every axis."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], 6)
    return true_transform() @ se3.exp(signs * np.repeat([metres, radians], 3))


def relit(view: View, gain: float, bias: float) -> View:
    """The view under another exposure."""
    grey: UInt8 = np.clip(gain * view.grey + bias, 0, 255).astype(np.uint8)
    return replace(view, grey=grey)


def assert_at_truth(found: Refinement, metres: float, radians: float) -> None:
    error = se3.inverse(true_transform()) @ found.T_model_source
    assert np.linalg.norm(error[:3, 3]) < metres
    assert se3.rotation_angle(error) < radians


def test_the_planes_of_a_model_are_on_its_surfaces_and_its_pixels_have_their_brightness() -> None:
    view, model = room_view(TIMES[0]), the_model()
    assert len(model.planes.points) > 1000
    assert [len(pixels.points) > 100 for pixels in model.pixels] == [True] * LEVELS
    points = model.planes.points
    u, v = np.rint(project(points, CAMERA)).astype(int).T
    off_surface = np.abs(view.depth[v, u] - points[:, 2])
    assert np.median(off_surface) < 0.002
    # where a window covers more than one surface, a plane lies between them
    assert np.quantile(off_surface, 0.9) < 0.02
    np.testing.assert_allclose(np.linalg.norm(model.planes.normals, axis=1), 1.0)
    finest = model.pixels[0]
    u, v = np.rint(project(finest.points, CAMERA)).astype(int).T
    np.testing.assert_array_equal(finest.brightness, view.grey[v, u])


def test_no_pixel_of_a_model_is_at_the_far_side_of_an_edge() -> None:
    """A near board before a wall, both with a pattern; at its rim the board's pixels alone stay."""
    rng = np.random.default_rng(0)
    grey = rng.integers(0, 255, (240, 320)).astype(np.uint8)
    depth = np.full((240, 320), 3.0, np.float32)
    depth[80:160, 100:200] = 1.5
    for level, pixels in enumerate(model_of(View(grey, depth, CAMERA), STEP).pixels):
        u, v = np.rint(project(pixels.points, CAMERA)).T
        wall = pixels.points[:, 2] > 2
        reach = 3 * 2**level
        beside = (u > 99 - reach) & (u < 200 + reach) & (v > 79 - reach) & (v < 160 + reach)
        assert not (wall & beside).any()
        assert (~wall).any()
        assert wall.any()


@given(SEEDS)
@settings(max_examples=10)
def test_refinement_converges_to_the_truth_from_any_realistic_start(seed: int) -> None:
    found = refine(perturbed(seed), the_problem())
    # pixels of 11 mm at 3 m are told apart to a tenth
    assert_at_truth(found, metres=0.002, radians=0.001)
    assert found.plane_agreement > 0.8
    assert found.brightness_correlation > 0.9


@pytest.mark.parametrize(("gain", "bias"), [(0.7, 20), (1.3, -30), (0.6, 0)])
def test_refinement_converges_to_the_truth_when_the_exposure_changes(
    gain: float, bias: float
) -> None:
    found = refine(perturbed(0), the_problem(relit(the_source(), gain, bias)))
    assert_at_truth(found, metres=0.002, radians=0.001)
    assert found.brightness_correlation > 0.9


def test_planes_alone_converge_near_the_truth_in_a_room_with_corners() -> None:
    config = replace(CONFIG, pixel_weight=0.0)
    dark = replace(the_source(), grey=np.zeros_like(the_source().grey))
    found = refine(perturbed(0), the_problem(dark, config=config))
    assert_at_truth(found, metres=0.01, radians=0.005)
    assert found.plane_agreement > 0.8
    assert found.brightness_correlation == 0.0


def test_pixels_alone_converge_to_the_truth_when_the_frame_has_no_depth() -> None:
    found = refine(perturbed(0), the_problem(without_depth(the_source())))
    assert_at_truth(found, metres=0.002, radians=0.001)
    assert found.planes_seen == 0
    assert found.plane_agreement == 0.0


def test_zero_iterations_only_evaluate_the_start() -> None:
    start = perturbed(0)
    found = refine(start, the_problem(config=replace(CONFIG, iterations=0)))
    np.testing.assert_array_equal(found.T_model_source, start)
    evaluated = evaluate_pose(start, the_problem())
    assert found.plane_agreement == evaluated.plane_agreement
    # under the light of coarser levels
    assert found.brightness_correlation == pytest.approx(evaluated.brightness_correlation, abs=0.05)


@pytest.mark.parametrize("twist", np.eye(6)[[2, 3, 4]] * 0.1, ids=["forward", "pitch", "yaw"])
def test_planes_and_pixels_reveal_a_wrong_pose(twist: Float64) -> None:
    right = evaluate_pose(true_transform(), the_problem())
    wrong = evaluate_pose(true_transform() @ se3.exp(twist), the_problem())
    assert wrong.plane_agreement < 0.5 * right.plane_agreement
    assert wrong.brightness_correlation < right.brightness_correlation - 0.1


def test_a_covered_camera_agrees_with_nothing() -> None:
    size = CAMERA.height, CAMERA.width
    covered = View(np.full(size, 17, np.uint8), np.full(size, 0.3, np.float32), CAMERA)
    found = refine(perturbed(0), the_problem(covered))
    assert found.plane_agreement < 0.1
    assert found.brightness_correlation == pytest.approx(0.0, abs=0.1)
    assert np.isfinite(found.T_model_source).all()


def test_if_nothing_of_the_model_is_visible_the_start_is_kept() -> None:
    elsewhere = se3.exp(np.array([0, 0, -50.0, 0, 0, 0]))
    for model in (the_model().moved(elsewhere), without_anything(the_model())):
        found = refine(perturbed(0), the_problem(model=model))
        np.testing.assert_allclose(found.T_model_source, perturbed(0), atol=1e-12)
        assert (found.planes_seen, found.pixels_seen, found.brightness_correlation) == (0, 0, 0.0)
        assert (found.information == 0).all()


def without_anything(model: Model) -> Model:
    """The model with no plane and no pixel."""
    rows, numbers = np.empty((0, 3)), np.empty(0)
    return Model(
        Planes(points=rows, normals=rows, velocity=rows, row_time=numbers),
        (Pixels(points=rows, brightness=numbers, velocity=rows, row_time=numbers),)
        * len(model.pixels),
    )


@given(SEEDS)
@settings(max_examples=5)
def test_the_information_is_symmetric_and_positive_definite(seed: int) -> None:
    config = replace(CONFIG, iterations=2)
    found = refine(perturbed(seed), the_problem(config=config))
    np.testing.assert_allclose(found.information, found.information.T, rtol=1e-12)
    assert np.linalg.eigvalsh(found.information).min() > 0


def test_one_wall_without_texture_leaves_three_directions_undetermined() -> None:
    """Along the wall, and about its normal."""
    size = CAMERA.height, CAMERA.width
    wall = View(np.full(size, 90, np.uint8), np.full(size, 2.0, np.float32), CAMERA)
    # moving a little keeps every residual zero, but for what the window's rim adds
    information = evaluate_pose(np.eye(4), the_problem(wall, model_of(wall, STEP))).information
    known = np.diag(information) > 1e-6 * np.diag(information).max()
    assert list(known) == [False, False, True, True, True, False]


def test_in_another_frame_the_model_gives_the_same_pose_there() -> None:
    T_odom_model = se3.exp(np.array([3.0, -2.0, 1.0, 0.3, 1.2, -0.5]))
    here = refine(perturbed(0), the_problem())
    there = refine(T_odom_model @ perturbed(0), the_problem(model=the_model().moved(T_odom_model)))
    np.testing.assert_allclose(there.T_model_source, T_odom_model @ here.T_model_source, atol=1e-4)


def test_a_blend_of_models_has_every_other_plane_and_pixel_of_both() -> None:
    one, two = the_model(), model_of(the_source(), STEP)
    both = blend([one, two])
    np.testing.assert_array_equal(
        both.planes.points, np.concatenate([one.planes.points[::2], two.planes.points[::2]])
    )
    for level in range(LEVELS):
        np.testing.assert_array_equal(
            both.pixels[level].brightness,
            np.concatenate([one.pixels[level].brightness[::2], two.pixels[level].brightness[::2]]),
        )


def test_the_same_models_are_blended_once_and_others_anew() -> None:
    one, two, blends = the_model(), model_of(the_source(), STEP), LastBlend()
    first = blends.of([one, two])
    assert blends.of([one, two]) is first
    for others in ([two, one], [one], [one, two, two]):
        expected = blend(others).planes.points
        np.testing.assert_array_equal(blends.of(others).planes.points, expected)


def test_a_blend_evaluates_a_pose_like_its_models() -> None:
    T = true_transform()
    one, two = the_model(), model_of(the_source(), STEP).moved(T)
    alone = [evaluate_pose(T, the_problem(model=model)) for model in (one, two)]
    both = evaluate_pose(T, the_problem(model=blend([one, two])))
    agreements = [found.plane_agreement for found in alone]
    assert min(agreements) - 0.02 < both.plane_agreement < max(agreements) + 0.02
    assert both.planes_seen < sum(found.planes_seen for found in alone) / 2 + 50


def test_with_sensor_noise_the_error_is_a_few_millimetres() -> None:
    rng = np.random.default_rng(0)
    depth = true_depth(true_pose(TIMES[1])).astype(np.float64)
    # in disparity, as the sensor errs: 2 mm at 1 m, 18 mm at 3 m
    noisy = 1 / (1 / depth + rng.normal(0, 0.002, depth.shape))
    source = replace(the_source(), depth=noisy.astype(np.float32))
    found = refine(perturbed(0), the_problem(source))
    assert_at_truth(found, metres=0.005, radians=0.003)
    assert found.plane_agreement > 0.5


def test_planes_hidden_by_a_person_are_counted_and_do_not_affect_the_pose() -> None:
    source = the_source()
    near = source.depth.copy()
    near[:, : CAMERA.width // 3] = 0.6
    found = refine(perturbed(1), the_problem(replace(source, depth=near)))
    assert_at_truth(found, 0.003, 0.002)
    assert 0.2 < found.planes_occluded / found.planes_seen < 0.5
    assert found.planes_visible == found.planes_seen - found.planes_occluded
    assert found.planes_agreeing > 0.9 * found.planes_visible


def test_planes_that_have_disappeared_do_not_count_as_occluded() -> None:
    source = the_source()
    far = replace(source, depth=source.depth + np.float32(3.0))
    found = evaluate_pose(true_transform(), the_problem(far))
    assert found.planes_seen > 0
    assert found.planes_occluded == 0


def test_occluded_pixels_are_left_out() -> None:
    source = the_source()
    width = CAMERA.width // 2
    near, painted = source.depth.copy(), source.grey.copy()
    near[:, :width] = 0.6
    painted[:, :width] = np.random.default_rng(0).integers(0, 256, painted[:, :width].shape)
    found = evaluate_pose(true_transform(), the_problem(replace(source, grey=painted)))
    hidden = evaluate_pose(true_transform(), the_problem(replace(source, grey=painted, depth=near)))
    assert hidden.pixels_seen < 0.7 * found.pixels_seen
    assert hidden.brightness_correlation > 0.9 > found.brightness_correlation
