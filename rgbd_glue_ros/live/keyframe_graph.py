"""The pose graph of a running node: keyframe poses of the published frame, and edges.

A keyframe with its edges takes about a kilobyte: at one a second, some 85 MB a day.
"""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.trajectories.pose_graph import GraphReader, write_graph
from rgbd_glue_ros.types import Float64, PoseGraph, PoseGraphEdge, Trajectory


def moved_edge(edge: PoseGraphEdge, T_camera_child: Float64) -> PoseGraphEdge:
    """Converts an edge between camera poses to one between frames fixed to the camera.

    Args:
        edge: edge between the optical frames.
        T_camera_child: pose of the other frame in the optical frame, float64 [4, 4].
    """
    T_child_camera = se3.inverse(T_camera_child)
    T = T_child_camera @ edge.T_parent_child @ T_camera_child
    covariance = se3.transported_covariance(T_child_camera, edge.covariance)
    return replace(edge, T_parent_child=T, covariance=covariance)


class KeyframeGraph:
    """The pose graph; one thread adds to it, and another may save it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.clear()

    def clear(self) -> None:
        """Removes everything, as after a reset."""
        with self._lock:
            self._poses: dict[int, tuple[int, Float64]] = {}
            self._edges: list[PoseGraphEdge] = []

    def add(self, number: int, stamp_ns: int, T_odom_child: Float64) -> None:
        """Adds a keyframe with its published pose [4, 4]."""
        with self._lock:
            self._poses[number] = stamp_ns, T_odom_child

    def add_edge(self, edge: PoseGraphEdge) -> None:
        """Adds an edge between keyframes, which it identifies by their numbers."""
        with self._lock:
            self._edges.append(edge)

    def stamp_ns(self, number: int) -> int | None:
        """The stamp of a keyframe, nanoseconds; None if the keyframe is unknown."""
        with self._lock:
            return self._poses[number][0] if number in self._poses else None

    @property
    def graph(self) -> PoseGraph:
        """The graph so far, without edges to unknown keyframes."""
        with self._lock:
            poses, edges = dict(sorted(self._poses.items())), tuple(self._edges)
        rows = {number: row for row, number in enumerate(poses)}
        keyframes = Trajectory(
            np.array([stamp for stamp, _ in poses.values()], np.int64),
            np.array([T for _, T in poses.values()]).reshape(-1, 4, 4),
        )
        renumbered = (
            replace(edge, parent=rows[edge.parent], child=rows[edge.child])
            for edge in edges
            if edge.parent in rows and edge.child in rows
        )
        return PoseGraph(keyframes, tuple(renumbered))

    def save(self, file: Path) -> str:
        """Writes one file for g2o, and another for GTSAM beside it.

        Args:
            file: the file for g2o; the one for GTSAM has ``_gtsam`` in its name. Missing folders
                are created.

        Returns:
            What was written, as text for the user.

        Raises:
            InputError: there is no keyframe yet, or the files cannot be written.
        """
        graph = self.graph
        if not len(graph.keyframes):
            raise InputError(file, "there is no keyframe yet", "wait for the first pose")
        for_gtsam = file.with_name(f"{file.stem}_gtsam{file.suffix}")
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            write_graph(file, graph, GraphReader.G2O)
            write_graph(for_gtsam, graph, GraphReader.GTSAM)
        except OSError as error:
            raise InputError(
                file, f"cannot be written ({error.strerror})", "set graph_file to another"
            ) from error
        counts = f"{len(graph.keyframes)} keyframes and {len(graph.edges)} edges"
        return f"{counts} in {file} (g2o) and {for_gtsam} (GTSAM)"
