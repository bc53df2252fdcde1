"""The graph of a running node, and its files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rigs.pose_graphs import random_graph

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.keyframe_graph import KeyframeGraph, moved_edge
from rgbd_glue_ros.trajectories.pose_graph import read_graph
from rgbd_glue_ros.types import PoseGraph

T_CAMERA_BASE = se3.exp(np.array([0.1, 0.2, -0.3, 0.4, -0.5, 0.6]))


def filled(graph: PoseGraph) -> KeyframeGraph:
    live = KeyframeGraph()
    for number, stamp in enumerate(graph.keyframes.stamps_ns):
        live.add(number, int(stamp), graph.keyframes.poses[number])
    for edge in graph.edges:
        live.add_edge(edge)
    return live


def test_a_saved_graph_is_read_from_both_files(tmp_path: Path) -> None:
    written = random_graph(10, 12)
    said = filled(written).save(tmp_path / "new" / "graph.g2o")
    assert said.startswith(f"12 keyframes and {len(written.edges)} edges")
    for name in ("graph.g2o", "graph_gtsam.g2o"):
        assert name in said
        read = read_graph(tmp_path / "new" / name)
        np.testing.assert_allclose(read.keyframes.poses, written.keyframes.poses, atol=1e-12)
        covariances = zip(read.edges, written.edges, strict=True)
        for edge, expected in covariances:
            np.testing.assert_allclose(edge.covariance, expected.covariance, atol=1e-10)


def test_an_edge_moved_to_the_robot_agrees_with_its_poses_and_covariance() -> None:
    written = random_graph(11, 4, noise=0.0)
    edge = written.edges[1]
    moved = moved_edge(edge, T_CAMERA_BASE)
    base = written.keyframes.poses @ T_CAMERA_BASE
    T = se3.inverse(base[edge.parent]) @ base[edge.child]
    np.testing.assert_allclose(moved.T_parent_child, T, atol=1e-12)
    xi = np.array([0.01, -0.02, 0.03, 0.002, 0.001, -0.003])
    T_camera = se3.exp(xi) @ edge.T_parent_child
    T_base = se3.inverse(T_CAMERA_BASE) @ T_camera @ T_CAMERA_BASE
    xi_base = se3.log(T_base @ se3.inverse(moved.T_parent_child))
    one = xi @ np.linalg.solve(edge.covariance, xi)
    other = xi_base @ np.linalg.solve(moved.covariance, xi_base)
    assert other == pytest.approx(one, rel=1e-6)


def test_an_edge_of_an_unknown_keyframe_is_left_out() -> None:
    written = random_graph(12, 9)
    live = KeyframeGraph()
    for number in (0, 1, 6):
        live.add(number, number, written.keyframes.poses[number])
    for edge in written.edges:
        live.add_edge(edge)
    # 0 - 1 by tracking and 0 - 6 by revisiting, whose row is 2
    assert [(edge.parent, edge.child) for edge in live.graph.edges] == [(0, 1), (0, 2)]
    assert (live.stamp_ns(6), live.stamp_ns(2)) == (6, None)


def test_a_graph_that_cannot_be_saved_says_why(tmp_path: Path) -> None:
    live = KeyframeGraph()
    with pytest.raises(InputError, match="no keyframe yet"):
        live.save(tmp_path / "graph.g2o")
    live.add(0, 0, np.eye(4))
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        live.save(tmp_path / "file" / "graph.g2o")
    live.clear()
    with pytest.raises(InputError, match="no keyframe yet"):
        live.save(tmp_path / "graph.g2o")
