"""Baselines: they find the few matches that agree among many that do not."""

from __future__ import annotations

import numpy as np
import pytest
from rigs.geometry import noisy_matches, random_transform, room_points

from rgbd_glue_ros.evaluation.registration_errors import rotation_deg, translation_cm
from rgbd_glue_ros.experiments.peers.mac import mac
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.registration.compatibility import length_differences, refined
from rgbd_glue_ros.registration.sc2_pcr import sc2_pcr
from rgbd_glue_ros.types import Correspondences, Float64

RIGHT, WRONG = 60, 540


def mostly_wrong(seed: int) -> tuple[Correspondences, Float64]:
    """Matches of which one in ten is right, with the transform of these."""
    rng = np.random.default_rng(seed)
    truth = random_transform(rng)
    wrong = Correspondences(room_points(rng, WRONG), room_points(rng, WRONG), np.ones(WRONG))
    matches = noisy_matches(rng, truth, RIGHT, sigma_m=0.005) + wrong
    return matches.select(rng.permutation(len(matches))), truth


def test_lengths_between_matches_are_kept_by_a_rigid_motion_alone() -> None:
    rng = np.random.default_rng(0)
    matches = noisy_matches(rng, random_transform(rng), 20, sigma_m=0.0)
    np.testing.assert_allclose(length_differences(matches), 0, atol=1e-6)
    stretched = Correspondences(matches.source, 2 * matches.target, matches.weights)
    between = np.linalg.norm(matches.source[:, None] - matches.source, axis=2)
    np.testing.assert_allclose(length_differences(stretched), between, atol=1e-6)


def test_a_rough_transform_is_refined_to_its_inliers() -> None:
    matches, truth = mostly_wrong(0)
    rough = se3.exp(np.array([0.02, 0.01, 0.0, 0.0, 0.01, 0.0])) @ truth
    better = refined(rough, matches, threshold=0.1)
    assert translation_cm(better, truth) < 0.5 < translation_cm(rough, truth)


@pytest.mark.parametrize("seed", range(5))
def test_sc2_pcr_finds_the_transform_of_one_match_in_ten(seed: int) -> None:
    matches, truth = mostly_wrong(seed)
    T, inliers = sc2_pcr(matches)
    assert T is not None
    assert translation_cm(T, truth) < 1
    assert rotation_deg(T, truth) < 0.5
    assert RIGHT <= inliers < 2 * RIGHT


@pytest.mark.parametrize("seed", range(5))
def test_mac_finds_the_transform_of_one_match_in_ten(seed: int) -> None:
    pytest.importorskip("networkx")
    matches, truth = mostly_wrong(seed)
    T = mac(matches)
    assert T is not None
    assert translation_cm(T, truth) < 1
    assert rotation_deg(T, truth) < 0.5


def test_two_matches_give_no_transform() -> None:
    pytest.importorskip("networkx")
    matches, _ = mostly_wrong(0)
    two = matches.select(np.arange(2))
    assert sc2_pcr(two) == (None, 0)
    assert mac(two) is None


def test_of_many_matches_those_of_the_greatest_weight_are_looked_at() -> None:
    matches, truth = mostly_wrong(1)
    right = np.linalg.norm(se3.transform(truth, matches.source) - matches.target, axis=1) < 0.05
    weighted = Correspondences(matches.source, matches.target, right + 0.1)
    T, inliers = sc2_pcr(weighted, most=RIGHT)
    assert T is not None
    assert inliers == right.sum()
