"""Every keyframe knows what it was tracked from; edges agree with the truth of the recording."""

from __future__ import annotations

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames, true_poses

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.gates import chi_squared, mahalanobis_squared
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import load_preset, with_values
from rgbd_glue_ros.types import EdgeOrigin, OdometryEstimate


@pytest.fixture(scope="module")
def estimates() -> list[OdometryEstimate]:
    # keyframes near each other, of which few are kept in the window, so that some are anchors
    near = {"keyframe_translation": 0.06, "keyframe_rotation": 0.06, "window": 2}
    config = with_values(
        load_preset("live"), {f"odometry.{name}": value for name, value in near.items()}
    )
    odometry = Odometry(config)
    return [odometry.process(frame) for frame in recorded_frames()]


@pytest.mark.slow
def test_every_keyframe_but_the_first_is_tracked_from_an_earlier_one(
    estimates: list[OdometryEstimate],
) -> None:
    keyframes = sum(estimate.is_keyframe for estimate in estimates)
    edges = [edge for estimate in estimates for edge in estimate.edges]
    tracked = [edge for edge in edges if edge.origin is EdgeOrigin.TRACKING]
    assert [edge.child for edge in tracked] == list(range(1, keyframes))
    assert all(edge.parent < edge.child for edge in edges)


def test_a_keyframe_that_revisits_the_view_of_an_anchor_has_an_edge_to_it(
    estimates: list[OdometryEstimate],
) -> None:
    edges = [edge for estimate in estimates for edge in estimate.edges]
    revisits = [(e.parent, e.child) for e in edges if e.origin is EdgeOrigin.REVISIT]
    assert len(revisits) >= 3
    assert len(set(revisits)) == len(revisits)
    tracked = {(e.parent, e.child) for e in edges if e.origin is EdgeOrigin.TRACKING}
    assert not tracked & set(revisits)


def test_edges_agree_with_the_truth_within_their_covariance(
    estimates: list[OdometryEstimate],
) -> None:
    truth = true_poses()
    rows = [row for row, estimate in enumerate(estimates) if estimate.is_keyframe]
    squared = []
    for edge in (edge for estimate in estimates for edge in estimate.edges):
        T_true = se3.inverse(truth[rows[edge.parent]]) @ truth[rows[edge.child]]
        xi = se3.log(edge.T_parent_child @ se3.inverse(T_true))
        squared.append(mahalanobis_squared(xi, edge.covariance))
        assert np.linalg.norm(xi[:3]) < 0.01
    assert np.mean(np.array(squared) < chi_squared(0.95, 6)) > 0.9
