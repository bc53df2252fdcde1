"""Reads and writes pose graphs, in the conventions of g2o and of GTSAM.

Both programs read ``EDGE_SE3:QUAT``, but interpret its information matrix differently. g2o's
residual is the translation and the vector part of the quaternion, half the rotation vector.
GTSAM's is the translation and the rotation vector itself. So there is a file for each.
"""

from __future__ import annotations

from enum import Enum
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.stamp_text import format_stamp, parse_stamp
from rgbd_glue_ros.files.text_lines import finite_numbers, numbers_text, parsed_lines
from rgbd_glue_ros.files.writing import write_whole
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.trajectories.pose_text import parse_pose, pose_text
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraph, PoseGraphEdge, Trajectory


class GraphReader(Enum):
    """The program that will read a file; the value scales a rotation vector to its residual."""

    G2O = 0.5
    GTSAM = 1.0

    @property
    def residual_scale(self) -> Float64:
        """Scales a twist [6] to the residual, float64 [6, 1]."""
        return np.repeat([1.0, self.value], 3)[:, None]


_VERTEX = "VERTEX_SE3:QUAT"
_EDGE = "EDGE_SE3:QUAT"
# comments with content: readers that do not know them skip them
_STAMP, _ORIGIN, _READER = "#stamp", "#origin", "#reader"
_UPPER = np.triu_indices(6)


def write_graph(path: Path, graph: PoseGraph, reader: GraphReader = GraphReader.G2O) -> None:
    """Writes a pose graph; vertex ids are rows, comments give stamps and origins of edges.

    The information matrix is that of the reader's residual, perturbed on the right as in both.

    Raises:
        InputError: the file cannot be written.
    """
    lines = [f"# information matrices as {reader.name} reads them", f"{_READER} {reader.name}"]
    rows = zip(graph.keyframes.stamps_ns, graph.keyframes.poses, strict=True)
    for row, (stamp, T) in enumerate(rows):
        lines += [f"{_STAMP} {row} {format_stamp(stamp)}", f"{_VERTEX} {row} {pose_text(T)}"]
    for edge in graph.edges:
        information = _information(edge, reader)[_UPPER]
        lines += [
            f"{_ORIGIN} {edge.origin.name.lower()}",
            " ".join(
                [
                    f"{_EDGE} {edge.parent} {edge.child}",
                    pose_text(edge.T_parent_child),
                    numbers_text(information),
                ]
            ),
        ]
    write_whole(path, "".join(f"{line}\n" for line in lines))


def read_graph(path: Path) -> PoseGraph:
    """The pose graph in a file that ``write_graph`` wrote.

    Raises:
        InputError: the file cannot be read, or a line in it is malformed.
    """
    stamps: dict[int, int] = {}
    poses: dict[int, Float64] = {}
    edges: list[PoseGraphEdge] = []
    reader, origin = GraphReader.G2O, EdgeOrigin.TRACKING

    def row(words: list[str]) -> None:
        nonlocal reader, origin
        if words[0] == _STAMP:
            stamps[int(words[1])] = parse_stamp(words[2])
        elif words[0] == _READER:
            reader = _reader(words[1])
        elif words[0] == _ORIGIN:
            origin = _origin(words[1])
        elif words[0] == _VERTEX:
            poses[int(words[1])] = parse_pose(words[2:])
        elif words[0] == _EDGE:
            edges.append(_edge(words, reader, origin))
        else:
            raise ValueError(f"unknown tag {words[0]}")

    for _ in parsed_lines(path, row, f"give {_VERTEX} and {_EDGE} lines", comment="# "):
        pass
    if sorted(poses) != list(range(len(poses))) or stamps.keys() != poses.keys():
        raise InputError(path, "its vertices are not 0, 1, 2… with stamps", "export it again")
    if not all(0 <= end < len(poses) for edge in edges for end in (edge.parent, edge.child)):
        raise InputError(path, "an edge names a missing vertex", "export it again")
    keyframes = Trajectory(
        np.array([stamps[i] for i in range(len(poses))], np.int64),
        np.array([poses[i] for i in range(len(poses))]).reshape(-1, 4, 4),
    )
    return PoseGraph(keyframes, tuple(edges))


def residual_covariance(edge: PoseGraphEdge, reader: GraphReader = GraphReader.GTSAM) -> Float64:
    """Covariance [6, 6] of the reader's residual, of Z^-1 X with Z as measured; translation first.

    A perturbation exp(xi) Z on the left is one of Ad(Z^-1) xi on the right.
    """
    A = se3.adjoint(se3.inverse(edge.T_parent_child)) * reader.residual_scale
    covariance: Float64 = A @ edge.covariance @ A.T
    return covariance


def _information(edge: PoseGraphEdge, reader: GraphReader) -> Float64:
    return np.asarray(np.linalg.inv(residual_covariance(edge, reader)), np.float64)


def _edge(words: list[str], reader: GraphReader, origin: EdgeOrigin) -> PoseGraphEdge:
    T = parse_pose(words[3:10])
    upper = np.zeros((6, 6))
    upper[_UPPER] = finite_numbers(words[10:], 21)
    information = upper + np.triu(upper, 1).T
    # the inverse of the matrix in ``residual_covariance``, which has its rows scaled
    A = se3.adjoint(T) / reader.residual_scale.T
    covariance = A @ np.linalg.inv(information) @ A.T
    return PoseGraphEdge(int(words[1]), int(words[2]), T, covariance, origin)


def _reader(name: str) -> GraphReader:
    if name not in GraphReader.__members__:
        raise ValueError(f"unknown reader {name}")
    return GraphReader[name]


def _origin(name: str) -> EdgeOrigin:
    if name.upper() not in EdgeOrigin.__members__:
        raise ValueError(f"unknown origin {name}")
    return EdgeOrigin[name.upper()]
