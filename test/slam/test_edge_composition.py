"""Edges over keyframes that the map does not have say what those over them said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from rigs.pose_graphs import random_edge

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.slam.edge_composition import (
    SkippedKeyframes,
    assumed_edge,
    composed,
    reversed_edge,
)
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraphEdge

RNG = np.random.default_rng(3)


def propagated(T: Callable[[Float64], Float64], covariance: Float64) -> Float64:
    """Covariance [6, 6] of T's perturbation on the left, by differences in what perturbs it."""
    h, columns = 1e-6, []
    for i in range(len(covariance)):
        step = np.zeros(len(covariance))
        step[i] = h
        columns.append(se3.log(T(step) @ se3.inverse(T(-step))) / (2 * h))
    J = np.array(columns).T
    return np.asarray(J @ covariance @ J.T)


def test_a_composed_edge_has_the_errors_of_both() -> None:
    first, second = random_edge(RNG, 4, 5), random_edge(RNG, 5, 9)
    edge = composed(first, second)
    assert (edge.parent, edge.child) == (4, 9)

    def T(xi: Float64) -> Float64:
        errors = se3.exp(xi[:6]), se3.exp(xi[6:])
        return np.asarray(errors[0] @ first.T_parent_child @ errors[1] @ second.T_parent_child)

    np.testing.assert_allclose(edge.T_parent_child, T(np.zeros(12)), atol=1e-12)
    both = np.zeros((12, 12))
    both[:6, :6], both[6:, 6:] = first.covariance, second.covariance
    np.testing.assert_allclose(edge.covariance, propagated(T, both), rtol=1e-5, atol=1e-10)


def test_a_reversed_edge_has_the_same_error_the_other_way() -> None:
    edge = random_edge(RNG, 4, 5)
    back = reversed_edge(edge)
    assert (back.parent, back.child) == (5, 4)

    def T(xi: Float64) -> Float64:
        return se3.inverse(se3.exp(xi) @ edge.T_parent_child)

    np.testing.assert_allclose(back.T_parent_child, T(np.zeros(6)), atol=1e-12)
    expected = propagated(T, edge.covariance)
    np.testing.assert_allclose(back.covariance, expected, rtol=1e-5, atol=1e-10)


@pytest.mark.parametrize(
    ("origins", "worse"),
    [
        ((EdgeOrigin.TRACKING, EdgeOrigin.TRACKING), EdgeOrigin.TRACKING),
        ((EdgeOrigin.ASSUMED, EdgeOrigin.TRACKING), EdgeOrigin.ASSUMED),
        ((EdgeOrigin.TRACKING, EdgeOrigin.REVISIT), EdgeOrigin.REVISIT),
        ((EdgeOrigin.REVISIT, EdgeOrigin.ASSUMED), EdgeOrigin.REVISIT),
    ],
)
def test_a_composed_edge_is_as_doubtful_as_the_worse_of_both(
    origins: tuple[EdgeOrigin, EdgeOrigin], worse: EdgeOrigin
) -> None:
    first, second = random_edge(RNG, 0, 1), random_edge(RNG, 1, 2)
    edge = composed(replace(first, origin=origins[0]), replace(second, origin=origins[1]))
    assert edge.origin is worse


def test_an_edge_to_a_skipped_keyframe_leads_on_to_a_known_one() -> None:
    skipped = SkippedKeyframes()
    to_skipped, revisit = random_edge(RNG, 4, 5), random_edge(RNG, 0, 5)
    skipped.add(5, to_skipped)
    found = skipped.bridged(revisit, {0, 4})
    assert found is not None
    assert (found.parent, found.child) == (0, 4)
    T = revisit.T_parent_child @ se3.inverse(to_skipped.T_parent_child)
    np.testing.assert_allclose(found.T_parent_child, T, atol=1e-12)
    assert np.linalg.eigvalsh(found.covariance).min() > 0


@pytest.mark.parametrize(
    "edge",
    [(7, 9), (6, 9), (9, 7), (2, 9), (5, 4), (4, 4)],
    ids=["unknown", "from a circle", "to unknown", "before the first", "back", "to itself"],
)
def test_what_says_nothing_of_two_known_keyframes_gives_no_edge(edge: tuple[int, int]) -> None:
    skipped = SkippedKeyframes()
    for parent, child in ((1, 2), (4, 5), (6, 8), (8, 6)):
        skipped.add(child, random_edge(RNG, parent, child))
    assert skipped.bridged(random_edge(RNG, *edge), {0, 4, 9}) is None


def test_what_is_assumed_of_stamps_in_any_order_has_a_covariance() -> None:
    T = se3.exp(np.array([0.3, 0.1, -0.2, 0.1, 0.4, -0.3]))
    for elapsed_ns in (0, 1, -(10**9), 10**9, 2**62):
        edge = assumed_edge(0, 1, T, elapsed_ns)
        assert isinstance(edge, PoseGraphEdge)
        assert np.linalg.eigvalsh(edge.covariance).min() > 0
