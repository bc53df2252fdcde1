"""Pose graphs survive their files; each file's information is that of its reader's residual."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rigs.pose_graphs import random_edge, random_graph
from scipy.spatial.transform import Rotation

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.trajectories.pose_graph import GraphReader, read_graph, write_graph
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraph


@pytest.mark.parametrize("reader", GraphReader)
def test_a_pose_graph_survives_a_file(tmp_path: Path, reader: GraphReader) -> None:
    written = random_graph(1, 4)
    write_graph(tmp_path / "keyframes.g2o", written, reader)
    read = read_graph(tmp_path / "keyframes.g2o")
    np.testing.assert_array_equal(read.keyframes.stamps_ns, written.keyframes.stamps_ns)
    np.testing.assert_allclose(read.keyframes.poses, written.keyframes.poses, atol=1e-13)
    assert len(read.edges) == len(written.edges)
    for edge, expected in zip(read.edges, written.edges, strict=True):
        assert (edge.parent, edge.child) == (expected.parent, expected.child)
        assert edge.origin is expected.origin
        np.testing.assert_allclose(edge.T_parent_child, expected.T_parent_child, atol=1e-13)
        np.testing.assert_allclose(edge.covariance, expected.covariance, rtol=1e-8, atol=1e-12)


def _g2o_residual(E: Float64) -> Float64:
    # toVectorMQT: translation, then the quaternion without w
    return np.concatenate([E[:3, 3], Rotation.from_matrix(E[:3, :3]).as_quat()[:3]])


@pytest.mark.parametrize(
    ("reader", "residual"), [(GraphReader.G2O, _g2o_residual), (GraphReader.GTSAM, se3.log)]
)
def test_the_information_is_that_of_the_readers_residual(
    tmp_path: Path, reader: GraphReader, residual: Callable[[Float64], Float64]
) -> None:
    edge = random_edge(np.random.default_rng(2), 0, 1)
    graph = PoseGraph(random_graph(2, 2).keyframes, (edge,))
    write_graph(tmp_path / "keyframes.g2o", graph, reader)
    lines = (tmp_path / "keyframes.g2o").read_text().splitlines()
    line = next(line for line in lines if line.startswith("EDGE"))
    upper = np.zeros((6, 6))
    upper[np.triu_indices(6)] = [float(word) for word in line.split()[10:]]
    information = upper + np.triu(upper, 1).T
    step = 1e-6
    Z = edge.T_parent_child
    moved = [se3.inverse(Z) @ se3.exp(step * axis) @ Z for axis in np.eye(6)]
    J = np.stack([residual(E) / step for E in moved], axis=1)
    np.testing.assert_allclose(information @ (J @ edge.covariance @ J.T), np.eye(6), atol=1e-3)


def test_a_file_of_another_program_is_read_as_g2os(tmp_path: Path) -> None:
    path = tmp_path / "other.g2o"
    pose = "0 0 0 0 0 0 1"
    upper = " ".join("1" if i == j else "0" for i in range(6) for j in range(i, 6))
    path.write_text(
        f"#stamp 0 1.0\nVERTEX_SE3:QUAT 0 {pose}\n#stamp 1 2.0\nVERTEX_SE3:QUAT 1 {pose}\n"
        f"EDGE_SE3:QUAT 0 1 {pose} {upper}\n"
    )
    (edge,) = read_graph(path).edges
    assert edge.origin is EdgeOrigin.TRACKING
    np.testing.assert_allclose(np.diag(edge.covariance), [1, 1, 1, 4, 4, 4])


@pytest.mark.parametrize(
    ("line", "cause"),
    [
        ("EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1 1", "1 values instead of 21"),
        ("VERTEX_SE2 0 0 0 0", "unknown tag VERTEX_SE2"),
        ("#reader CERES", "unknown reader CERES"),
        ("#origin hearsay", "unknown origin hearsay"),
        ("VERTEX_SE3:QUAT 7 0 0 0 0 0 0 1", "its vertices are not 0, 1"),
    ],
)
def test_a_malformed_line_is_refused(tmp_path: Path, line: str, cause: str) -> None:
    path = tmp_path / "keyframes.g2o"
    write_graph(path, random_graph(3, 3))
    path.write_text(path.read_text() + line + "\n")
    with pytest.raises(InputError, match=cause):
        read_graph(path)


def test_an_edge_to_a_keyframe_that_is_not_there_is_refused(tmp_path: Path) -> None:
    edge = random_edge(np.random.default_rng(4), 0, 9)
    write_graph(tmp_path / "keyframes.g2o", PoseGraph(random_graph(4, 2).keyframes, (edge,)))
    with pytest.raises(InputError, match="names a missing vertex"):
        read_graph(tmp_path / "keyframes.g2o")
