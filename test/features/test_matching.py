"""Nearest neighbours are those that other libraries find; matches are one to one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from rigs.geometry import SEEDS
from scipy.spatial import KDTree

from rgbd_glue_ros.features.matching import distance_ratio, nearest_two, one_to_one
from rgbd_glue_ros.types import Float64


@given(SEEDS, st.integers(1, 40), st.integers(2, 40))
def test_neighbours_of_float_descriptors_are_those_of_a_tree(
    seed: int, queries: int, references: int
) -> None:
    rng = np.random.default_rng(seed)
    query = rng.normal(size=(queries, 33)).astype(np.float32)
    reference = rng.normal(size=(references, 33)).astype(np.float32)
    index, distances = nearest_two(query, reference)
    expected, neighbours = KDTree(reference).query(query, k=2)
    np.testing.assert_array_equal(index, neighbours[:, 0])
    np.testing.assert_allclose(distances, expected, rtol=1e-5)


def test_more_descriptors_than_are_held_at_once_are_matched_as_by_opencv() -> None:
    rng = np.random.default_rng(0)
    query = rng.integers(0, 256, (5000, 16)).astype(np.float32)
    reference = rng.integers(0, 256, (300, 16)).astype(np.float32)
    index, distances = nearest_two(query, reference)
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(query, reference, k=2)
    expected = np.array([[first.distance, second.distance] for first, second in pairs])
    np.testing.assert_allclose(distances, expected, rtol=1e-6)
    np.testing.assert_allclose(
        np.linalg.norm(query - reference[index], axis=1), expected[:, 0], rtol=1e-6
    )


@given(SEEDS, st.integers(1, 40), st.integers(2, 40), st.sampled_from([1, 8, 32, 61, 64]))
def test_neighbours_of_binary_descriptors_differ_in_the_fewest_bits(
    seed: int, queries: int, references: int, size: int
) -> None:
    rng = np.random.default_rng(seed)
    query = rng.integers(0, 256, (queries, size), np.uint8)
    reference = rng.integers(0, 256, (references, size), np.uint8)
    index, distances = nearest_two(query, reference)
    bits = np.unpackbits(query[:, None] ^ reference[None], axis=2).sum(axis=2)
    np.testing.assert_array_equal(distances, np.sort(bits, axis=1)[:, :2])
    np.testing.assert_array_equal(bits[np.arange(queries), index], distances[:, 0])


def test_binary_descriptors_have_the_distances_that_opencv_finds() -> None:
    rng = np.random.default_rng(0)
    query = rng.integers(0, 256, (700, 32), np.uint8)
    reference = rng.integers(0, 256, (900, 32), np.uint8)
    _, distances = nearest_two(query, reference)
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(query, reference, k=2)
    expected = [[first.distance, second.distance] for first, second in pairs]
    np.testing.assert_array_equal(distances, expected)


def test_small_distances_between_long_descriptors_do_not_drown_in_rounding() -> None:
    # |a|² - 2 a·b + |b|² has no digit left: in float32, 4e6 is rounded to quarters
    query = np.full((1, 4), 1000.0, np.float32)
    reference = query + np.array([[0.015625], [0.03125]], np.float32)
    _, distances = nearest_two(query, reference)
    np.testing.assert_array_equal(np.sort(distances), [[0.03125, 0.0625]])


@pytest.mark.parametrize("kind", [np.float32, np.uint8])
def test_of_equal_descriptors_both_distances_are_zero(kind: type) -> None:
    _, distances = nearest_two(np.zeros((1, 8), kind), np.zeros((2, 8), kind))
    np.testing.assert_array_equal(distances, [[0, 0]])


@pytest.mark.parametrize("kind", [np.float32, np.uint8])
def test_no_query_has_no_neighbour(kind: type) -> None:
    index, distances = nearest_two(np.empty((0, 8), kind), np.zeros((2, 8), kind))
    assert index.shape == (0,)
    assert distances.shape == (0, 2)


def test_the_ratio_is_that_of_equation_1_and_tells_nothing_from_nothing_at_1() -> None:
    distances = np.array([[1.0, 2.0], [3.0, 3.0], [0.0, 5.0], [0.0, 0.0]])
    np.testing.assert_array_equal(distance_ratio(distances), [0.5, 1.0, 0.0, 1.0])
    assert distance_ratio(np.empty((0, 2))).shape == (0,)


@given(
    arrays.arrays(np.int64, st.shared(st.integers(0, 30), key="n"), elements=st.integers(0, 9)),
    arrays.arrays(np.float64, st.shared(st.integers(0, 30), key="n"), elements=st.floats(0, 1)),
)
@example(np.array([3, 3, 3]), np.array([0.5, 0.5, 0.5]))
def test_every_target_keeps_its_cheapest_match(
    target: np.ndarray[tuple[int], np.dtype[np.int64]], cost: Float64
) -> None:
    kept = one_to_one(target, cost)
    assert sorted(target[kept]) == sorted({*target})
    for row in kept:
        assert cost[row] == cost[target == target[row]].min()
    assert list(kept) == sorted(kept)


def test_the_nearest_is_no_farther_than_the_second_however_many_digits_cancel() -> None:
    rng = np.random.default_rng(0)
    base = rng.uniform(0, 200, (1, 33))
    reference = (base + rng.normal(0, 1e-3, (50, 33))).astype(np.float32)
    query = (base + rng.normal(0, 1e-3, (200, 33))).astype(np.float32)
    index, distances = nearest_two(query, reference)
    assert (distances[:, 0] <= distances[:, 1]).all()
    nearest = np.linalg.norm(query - reference[index], axis=1)
    np.testing.assert_allclose(nearest, distances[:, 0], rtol=1e-6)
    assert (distance_ratio(distances) <= 1).all()
