"""Rigid fits: exact where they can be, optimal where they cannot, unmoved by outliers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rigs.geometry import (
    SEEDS,
    noisy_matches,
    random_transform,
    room_points,
    transforms,
    wrong_matches,
)
from scipy.spatial.transform import Rotation
from scipy.stats import chisquare

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import (
    _samples,
    distances,
    procrustes,
    procrustes_information,
    randomised_procrustes,
    ransac,
)
from rgbd_glue_ros.types import Correspondences, Float64

THRESHOLD_M = 0.05


def fit(matches: Correspondences) -> Float64:
    return np.asarray(procrustes(matches.source, matches.target, matches.weights))


def weighted(matches: Correspondences, rng: np.random.Generator) -> Correspondences:
    weights = rng.uniform(0.1, 2.0, len(matches))
    return Correspondences(matches.source, matches.target, weights)


def cost(T: Float64, matches: Correspondences) -> float:
    """The sum that equation 10 minimises."""
    return float(matches.weights @ distances(T, matches) ** 2)


def numerical_jacobian(function: Callable[[Float64], Float64], size: int) -> Float64:
    """Of a function of a vector at zero, by central differences."""
    step = 1e-6
    columns = [(function(step * e) - function(-step * e)) / (2 * step) for e in np.eye(size)]
    return np.stack(columns, axis=-1)


def assert_close(T: Float64, truth: Float64, metres: float, radians: float) -> None:
    difference = se3.inverse(truth) @ T
    assert np.linalg.norm(difference[:3, 3]) < metres
    assert se3.rotation_angle(difference) < radians


# weighted Procrustes


@given(transforms(), SEEDS, st.integers(3, 50))
def test_exact_matches_of_any_weights_give_their_transform(
    T: Float64, seed: int, count: int
) -> None:
    rng = np.random.default_rng(seed)
    matches = weighted(noisy_matches(rng, T, count, sigma_m=0.0), rng)
    np.testing.assert_allclose(distances(fit(matches), matches), 0.0, atol=1e-12)


@given(SEEDS)
def test_noisy_matches_give_the_rotation_that_scipy_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matches = weighted(noisy_matches(rng, random_transform(rng), 30, sigma_m=0.1), rng)
    w = matches.weights / matches.weights.sum()
    mean_p, mean_q = w @ matches.source, w @ matches.target
    R, _ = Rotation.align_vectors(matches.target - mean_q, matches.source - mean_p, w)
    T = fit(matches)
    np.testing.assert_allclose(T[:3, :3], R.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(se3.transform(T, mean_p[None])[0], mean_q, atol=1e-12)


@given(SEEDS)
def test_no_other_transform_nearby_fits_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matches = weighted(noisy_matches(rng, random_transform(rng), 12, sigma_m=0.3), rng)
    T = fit(matches)
    least = cost(T, matches)
    for _ in range(20):
        assert cost(se3.exp(rng.normal(0, 0.01, 6)) @ T, matches) > least


@given(SEEDS)
def test_mirrored_points_give_a_rotation_and_no_reflection(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source = room_points(rng, 20)
    matches = Correspondences(source, source * [-1, 1, 1], np.ones(20))
    T = fit(matches)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)
    least = cost(T, matches)
    for _ in range(20):
        assert cost(se3.exp(rng.normal(0, 0.01, 6)) @ T, matches) > least - 1e-9


@given(transforms(), SEEDS)
def test_points_of_a_plane_fix_the_transform(T: Float64, seed: int) -> None:
    source = room_points(np.random.default_rng(seed), 10)
    source[:, 2] = 2.0
    matches = Correspondences(source, se3.transform(T, source), np.ones(10))
    np.testing.assert_allclose(fit(matches), T, atol=1e-6)


@pytest.mark.slow
@given(transforms(), SEEDS)
def test_points_of_a_line_are_fitted_by_some_rotation(T: Float64, seed: int) -> None:
    along = np.random.default_rng(seed).uniform(-1, 1, 10)
    source = np.outer(along, [0.6, 0.0, 0.8])
    matches = Correspondences(source, se3.transform(T, source), np.ones(10))
    found = fit(matches)
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(distances(found, matches), 0.0, atol=1e-7)


def test_matches_without_weight_do_not_count() -> None:
    rng = np.random.default_rng(0)
    T = random_transform(rng)
    right, wrong = noisy_matches(rng, T, 10, sigma_m=0.0), wrong_matches(rng, 30)
    silent = Correspondences(wrong.source, wrong.target, np.zeros(30))
    np.testing.assert_allclose(fit(right + silent), T, atol=1e-12)


@given(transforms(), SEEDS)
def test_the_information_is_the_curvature_of_the_cost(T: Float64, seed: int) -> None:
    rng = np.random.default_rng(seed)
    matches = weighted(noisy_matches(rng, T, 8, sigma_m=0.1), rng)

    def moved(xi: Float64) -> Float64:
        return se3.transform(se3.exp(xi) @ T, matches.source).ravel()

    J = numerical_jacobian(moved, 6)
    expected = J.T @ np.diag(matches.weights.repeat(3)) @ J
    information = procrustes_information(T, matches)
    np.testing.assert_allclose(information, expected, rtol=1e-6, atol=1e-5)


# randomised weighted Procrustes


def test_without_subsets_all_matches_are_fitted_at_once() -> None:
    rng = np.random.default_rng(0)
    matches = noisy_matches(rng, random_transform(rng), 20, sigma_m=0.1)
    np.testing.assert_array_equal(randomised_procrustes(matches, 0, 0.2, rng), fit(matches))


def test_a_subset_without_outliers_wins_over_the_fit_to_all() -> None:
    rng = np.random.default_rng(0)
    T = random_transform(rng)
    # 20 of 100 without any of 5 outliers: one subset in three
    matches = noisy_matches(rng, T, 95, sigma_m=0.002) + wrong_matches(rng, 5)
    randomised = randomised_procrustes(matches, 10, 0.2, rng)
    assert_close(randomised, T, metres=0.005, radians=0.005)
    all_at_once = se3.inverse(T) @ fit(matches)
    assert np.linalg.norm(all_at_once[:3, 3]) > 0.05


def test_the_same_seed_gives_the_same_bits() -> None:
    rng = np.random.default_rng(0)
    matches = noisy_matches(rng, random_transform(rng), 50, sigma_m=0.1)
    one, same, other = (
        randomised_procrustes(matches, 10, 0.2, np.random.default_rng(seed)) for seed in (7, 7, 8)
    )
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()


@pytest.mark.parametrize("count", [3, 4, 10])
def test_few_matches_are_fitted_in_subsets_of_three_at_least(count: int) -> None:
    rng = np.random.default_rng(0)
    T = random_transform(rng)
    matches = noisy_matches(rng, T, count, sigma_m=0.0)
    np.testing.assert_allclose(randomised_procrustes(matches, 10, 0.2, rng), T, atol=1e-9)


def test_when_hardly_any_match_has_weight_no_subset_of_the_others_wins() -> None:
    rng = np.random.default_rng(0)
    T = random_transform(rng)
    right, wrong = noisy_matches(rng, T, 3, sigma_m=0.0), wrong_matches(rng, 997)
    matches = right + Correspondences(wrong.source, wrong.target, np.zeros(997))
    np.testing.assert_allclose(randomised_procrustes(matches, 10, 0.5, rng), T, atol=1e-9)


# RANSAC


@given(SEEDS)
def test_ransac_finds_the_transform_among_60_percent_outliers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = random_transform(rng)
    matches = noisy_matches(rng, truth, 40, sigma_m=0.005) + wrong_matches(rng, 60)
    T, count = ransac(matches, THRESHOLD_M, 1000, rng)
    assert T is not None
    assert_close(T, truth, metres=0.02, radians=0.02)
    assert count == (distances(T, matches) <= THRESHOLD_M).sum() >= 40


@pytest.mark.parametrize("seed", range(5))
def test_ransac_finds_the_transform_among_80_percent_outliers(seed: int) -> None:
    # a sample of three is right once in 125: all of 2000 are wrong once in ten million times
    rng = np.random.default_rng(seed)
    truth = random_transform(rng)
    matches = noisy_matches(rng, truth, 40, sigma_m=0.005) + wrong_matches(rng, 160)
    T, _ = ransac(matches, THRESHOLD_M, 2000, rng)
    assert T is not None
    assert_close(T, truth, metres=0.02, radians=0.02)


def test_ransac_gives_the_same_bits_for_the_same_seed() -> None:
    rng = np.random.default_rng(0)
    matches = noisy_matches(rng, random_transform(rng), 50, sigma_m=0.02) + wrong_matches(rng, 50)
    results = [ransac(matches, THRESHOLD_M, 500, np.random.default_rng(3)) for _ in range(2)]
    assert results[0][0] is not None
    np.testing.assert_array_equal(results[0][0], results[1][0])
    assert results[0][1] == results[1][1]


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_matches_give_no_transform(count: int) -> None:
    rng = np.random.default_rng(0)
    matches = noisy_matches(rng, np.eye(4), count, sigma_m=0.0)
    assert ransac(matches, THRESHOLD_M, 100, rng) == (None, 0)


def test_matches_that_do_not_agree_give_no_transform() -> None:
    # three lengths that agree within 2 mm by chance: not once in millions of samples
    rng = np.random.default_rng(0)
    assert ransac(wrong_matches(rng, 100), 0.001, 1000, rng) == (None, 0)


def test_matches_of_one_point_give_no_transform() -> None:
    point = np.tile([0.1, 0.2, 2.0], (50, 1))
    matches = Correspondences(point, point, np.ones(50))
    assert ransac(matches, THRESHOLD_M, 100, np.random.default_rng(0)) == (None, 0)


def test_samples_are_of_three_different_matches_each_as_likely_as_any() -> None:
    samples = _samples(5, 60_000, np.random.default_rng(0))
    triples, counts = np.unique(samples, axis=0, return_counts=True)
    assert all(len({*triple}) == 3 for triple in triples.tolist())
    assert len(triples) == 5 * 4 * 3
    assert chisquare(counts).pvalue > 1e-3
