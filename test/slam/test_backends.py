"""g2o and GTSAM, each reading its own file, agree with each other and with factors made here."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rigs.pose_graphs import random_graph

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.slam.optimiser import factor_graph, optimise
from rgbd_glue_ros.trajectories.pose_graph import GraphReader, write_graph
from rgbd_glue_ros.types import Float64, PoseGraph

gtsam: Any = pytest.importorskip("gtsam", reason="GTSAM is not installed")
# Residuals of the two are equal to first order; these standard deviations make the rest small.
NOISE = 0.1


def graph() -> PoseGraph:
    return random_graph(5, 40, NOISE)


def g2o_optimum(path: Path) -> tuple[Float64, float]:
    """Poses [N, 4, 4] and chi² as g2o has them, the first vertex fixed."""
    g2o: Any = pytest.importorskip("g2opy", reason="g2opy is not installed")
    optimizer = g2o.SparseOptimizer()
    solver = g2o.BlockSolverSE3(g2o.LinearSolverEigenSE3())
    optimizer.set_algorithm(g2o.OptimizationAlgorithmLevenberg(solver))
    assert optimizer.load(str(path))
    optimizer.vertex(0).set_fixed(True)
    optimizer.initialize_optimization()
    optimizer.optimize(50)
    optimizer.compute_active_errors()
    poses = [optimizer.vertex(i).estimate().matrix() for i in range(len(optimizer.vertices()))]
    return np.array(poses), optimizer.chi2()


def gtsam_optimum(factors: Any, values: Any) -> tuple[Float64, float]:
    found = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    poses = [found.atPose3(i).matrix() for i in range(found.size())]
    return np.array(poses), 2 * factors.error(found)


def test_the_three_have_the_same_optimum_and_the_same_chi_squared(tmp_path: Path) -> None:
    written = graph()
    write_graph(tmp_path / "keyframes.g2o", written, GraphReader.G2O)
    write_graph(tmp_path / "keyframes_gtsam.g2o", written, GraphReader.GTSAM)

    factors, values = gtsam.readG2o(str(tmp_path / "keyframes_gtsam.g2o"), True)
    assert factors.size() == len(written.edges)
    factors.add(factor_graph(gtsam, written).at(0))
    built = factor_graph(gtsam, written)

    poses, chi_squared = gtsam_optimum(built, values)
    assert chi_squared > 0.1
    for others_poses, others_chi_squared in (
        gtsam_optimum(factors, values),
        g2o_optimum(tmp_path / "keyframes.g2o"),
    ):
        assert others_chi_squared == pytest.approx(chi_squared, rel=1e-3)
        np.testing.assert_allclose(others_poses, poses, atol=2e-4)


def test_each_program_needs_its_own_file(tmp_path: Path) -> None:
    """Read by GTSAM, g2o's file has rotations that weigh four times too much."""
    written = graph()
    write_graph(tmp_path / "keyframes.g2o", written, GraphReader.G2O)
    factors, values = gtsam.readG2o(str(tmp_path / "keyframes.g2o"), True)
    built = factor_graph(gtsam, written)
    theirs = factors.at(0).noiseModel().information()[:3, :3]
    ours = built.at(1).noiseModel().information()[:3, :3]
    np.testing.assert_allclose(theirs, 4 * ours, rtol=1e-9)
    assert values.size() == len(written.keyframes)


def test_chi_squared_of_honest_noise_is_as_great_as_its_degrees_of_freedom() -> None:
    many = [optimise(random_graph(seed, 40, 1.0)) for seed in range(5)]
    degrees = sum(optimum.degrees_of_freedom for optimum in many)
    total = sum(optimum.chi_squared for optimum in many)
    # five standard deviations of chi²
    assert abs(total - degrees) < 5 * np.sqrt(2 * degrees)


def test_the_optimum_is_nearer_to_the_truth_than_the_way_along_the_edges() -> None:
    true = random_graph(6, 60, 1.0)
    poses = [true.keyframes.poses[0]]
    for edge in true.edges[: len(true.keyframes) - 1]:
        poses.append(poses[-1] @ edge.T_parent_child)
    start = replace(true, keyframes=replace(true.keyframes, poses=np.array(poses)))
    found = optimise(start).graph.keyframes.poses

    def error(estimate: Float64) -> float:
        return float(np.linalg.norm(estimate[:, :3, 3] - true.keyframes.poses[:, :3, 3]))

    assert error(found) < 0.7 * error(start.keyframes.poses)


def test_a_false_loop_is_not_believed_and_changes_nothing() -> None:
    right = random_graph(7, 40, 1.0)
    false = replace(
        right.edges[-1], parent=2, child=35, T_parent_child=se3.exp(np.array([3.0, 0, 0, 0, 1, 0]))
    )
    expected = optimise(right)
    found = optimise(replace(right, edges=(*right.edges, false)))
    assert found.weights[-1] == pytest.approx(0.0, abs=1e-6)
    assert (found.weights[:-1] == 1.0).all()
    np.testing.assert_allclose(
        found.graph.keyframes.poses, expected.graph.keyframes.poses, atol=1e-4
    )
