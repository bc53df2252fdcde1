"""Planes agree with one of two poses for a reason, or by chance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2_contingency

from rgbd_glue_ros.geometry.depth import depth_sigma
from rgbd_glue_ros.odometry.plane_counts import PlaneCounts
from rgbd_glue_ros.parameters import RefineConfig
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.types import CameraIntrinsics, Float64, View

K = CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
WALL_AT_M = 2.0
NEIGHBOURS_ALIKE = 3


def at(x: float, z: float) -> Float64:
    """A pose with this position."""
    T = np.eye(4)
    T[[0, 2], 3] = x, z
    return T


def of_wall(T: Float64, T_other: Float64) -> PlaneCounts:
    """What the planes of a wall straight ahead say about two poses; the camera is at the origin."""
    wall = View(np.full((240, 320), 128, np.uint8), np.full((240, 320), WALL_AT_M, np.float32), K)
    config = RefineConfig()
    problem = RefinementProblem(model_of(wall, config.grid_step), wall, config)
    return PlaneCounts.of(T, T_other, problem.at_level(0))


def drawn(seed: int, often: float, often_with_other: float) -> PlaneCounts:
    """Counts of 600 planes that agree with each pose this often, but for noise of neighbours."""
    random = np.random.default_rng(seed)
    first, other = (
        np.repeat(random.random(600 // NEIGHBOURS_ALIKE) < p, NEIGHBOURS_ALIKE)
        for p in (often, often_with_other)
    )
    return PlaneCounts(
        *(int(np.count_nonzero(a & b)) for a in (first, ~first) for b in (other, ~other))
    )


def test_a_wall_does_not_tell_poses_along_it_apart() -> None:
    assert of_wall(at(0.3, 0.0), at(0.0, 0.0)) == PlaneCounts(0, 0, 0, 0)


def test_a_wall_tells_apart_what_is_nearer_to_it_by_more_than_noise() -> None:
    sigma = depth_sigma(WALL_AT_M)
    assert of_wall(at(0.0, 2 * sigma), at(0.0, 0.0)) == PlaneCounts(0, 0, 0, 0)
    counts = of_wall(at(0.0, 0.0), at(0.0, 5 * sigma))
    assert counts.alone > 2000
    assert counts == PlaneCounts(0, counts.alone, 0, 0)
    assert counts.are_for_first


def test_planes_that_are_hidden_at_a_pose_are_not_counted() -> None:
    # the wall is nearer than expected by far more than noise, as a person would be
    assert of_wall(at(0.0, -0.5), at(0.0, 0.0)) == PlaneCounts(0, 0, 0, 0)


@pytest.mark.parametrize("counts", [(44, 440, 91, 47), (68, 43, 20, 8), (240, 33, 27, 3)])
def test_the_evidence_of_a_part_is_the_root_of_chi_squared(counts: tuple[int, ...]) -> None:
    both, alone, other_alone, neither = counts
    table = [[both, alone], [other_alone, neither]]
    expected = np.sqrt(chi2_contingency(table, correction=False).statistic)
    assert PlaneCounts(*counts).sigmas_of_part == pytest.approx(expected)


def test_noise_is_hardly_ever_for_a_pose() -> None:
    mistaken = sum(drawn(seed, 0.88, 0.88).are_for_first for seed in range(2000))
    assert mistaken < 20


def test_a_part_that_follows_another_pose_is_for_it_though_it_is_smaller() -> None:
    counts = PlaneCounts(both=80, alone=177, other_alone=559, neither=19)
    assert counts.are_for_first


def test_planes_are_for_a_pose_if_hardly_any_are_for_the_other() -> None:
    counts = PlaneCounts(both=75, alone=198, other_alone=9, neither=39)
    assert counts.sigmas_of_part < 0
    assert counts.are_for_first
    assert not PlaneCounts(both=75, alone=9, other_alone=198, neither=39).are_for_first


def test_no_planes_are_for_no_pose() -> None:
    assert not PlaneCounts(0, 0, 0, 0).are_for_first
