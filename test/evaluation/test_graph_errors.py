"""Edges whose noise is what their covariance says have a chi² of one per degree of freedom."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.pose_graphs import random_graph

from rgbd_glue_ros.evaluation.graph_errors import edge_errors
from rgbd_glue_ros.types import NANOSECONDS, EdgeOrigin, Trajectory


@pytest.mark.parametrize("noise", [1.0, 2.0])
def test_chi_squared_grows_with_the_square_of_the_noise(noise: float) -> None:
    graph = random_graph(8, 400, noise)
    # rows of the truth no farther apart than it may be interpolated over
    stamps = np.arange(400) * NANOSECONDS // 20
    graph = replace(graph, keyframes=replace(graph.keyframes, stamps_ns=stamps))
    errors = edge_errors(graph, graph.keyframes)
    assert set(errors) == {EdgeOrigin.TRACKING, EdgeOrigin.REVISIT}
    assert errors[EdgeOrigin.TRACKING].count == 399
    for origin in errors.values():
        assert origin.chi2_per_dof == pytest.approx(noise**2, rel=0.2)
        assert origin.median_chi2_per_dof == pytest.approx(noise**2, rel=0.2)


def test_edges_without_truth_are_not_counted() -> None:
    graph = random_graph(9, 10)
    elsewhere = Trajectory(np.array([-2, -1]), np.stack([np.eye(4)] * 2))
    assert edge_errors(graph, elsewhere) == {}
