"""A map that grows while the odometry runs elsewhere: keyframes and edges in, corrections out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rgbd_glue_ros.evaluation.pose_graph import PoseGraph
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import view_of
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam.appearance import SearchTree
from rgbd_glue_ros.slam.incremental import IncrementalOptimiser
from rgbd_glue_ros.slam.map_file import SavedMap
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.slam.mapper import Mapper
from rgbd_glue_ros.types import Float64, PoseGraphEdge, RgbdFrame, Trajectory


@dataclass(frozen=True)
class Keyed:
    """A keyframe as it was published.

    Attributes:
        frame: its images.
        T_odom_camera: float64 [4, 4].
        edges: to earlier keyframes, between optical frames, by the odometry's numbers.
    """

    frame: RgbdFrame
    T_odom_camera: Float64
    edges: tuple[PoseGraphEdge, ...] = ()


class LiveMap:
    """Closes loops as keyframes arrive.

    With an existing map, keyframes wait until one of them shows a place of it.

    Attributes:
        poses: T_map_camera [4, 4] of every keyframe, by its row.
        loops: number of closed loops.
        T_map_odom: float64 [4, 4]; None until a place of the map is recognised.
    """

    def __init__(self, config: Config, before: SavedMap | None = None) -> None:
        """Creates a map.

        Args:
            config: how keyframes are compared.
            before: an existing map; None starts an empty one.

        Raises:
            MissingExtraError: the libraries of the extra slam are not installed.
        """
        self._config = config
        self._before = before
        self._glue = Glue(config)
        self.clear()

    def clear(self) -> None:
        """Starts over, from the existing map if there is one."""
        self._mapper = Mapper(self._config, self._glue, SearchTree())
        self._optimiser = IncrementalOptimiser()
        self._rows: dict[int, int] = {}
        self._waiting: list[tuple[int, Keyed]] = []
        self.poses: dict[int, Float64] = {}
        self.loops = 0
        self.T_map_odom: Float64 | None = np.eye(4)
        if self._before is not None:
            self._restore(self._before)

    @property
    def is_placed(self) -> bool:
        """Whether the pose of ``odom`` in the map is known."""
        return self.T_map_odom is not None

    def add(self, number: int, keyed: Keyed) -> None:
        """Adds a keyframe with its edges.

        Without an edge to a known keyframe, as for the first one, it is fixed at its odometry pose.

        Args:
            number: the odometry's.
            keyed: the keyframe.
        """
        if self.T_map_odom is None:
            self._waiting.append((number, keyed))
            if self.locate(keyed):
                waiting, self._waiting = self._waiting, []
                self._add(waiting)
        else:
            self._add([(number, keyed)])

    def locate(self, keyed: Keyed) -> bool:
        """Searches for a keyframe among those of the map, which is not changed.

        Returns:
            Whether it was found; ``T_map_odom`` is then that of the keyframe.
        """
        keyframe = self._keyframe(len(self._mapper.keyframes), keyed)
        loops = self._mapper.recognised(keyframe)
        if not loops:
            return False
        T_map_camera = self.poses[loops[0].parent] @ loops[0].T_parent_child
        self.T_map_odom = T_map_camera @ se3.inverse(keyed.T_odom_camera)
        return True

    def stamps_ns(self) -> dict[int, int]:
        """Stamps of the keyframes by their rows."""
        return {keyframe.number: keyframe.stamp_ns for keyframe in self._mapper.keyframes}

    def saved(self) -> SavedMap:
        """The current map, for a file."""
        keyframes = self._mapper.keyframes
        stamps = np.array([keyframe.stamp_ns for keyframe in keyframes], np.int64)
        poses = np.array([self.poses[row] for row in range(len(keyframes))]).reshape(-1, 4, 4)
        graph = PoseGraph(Trajectory(stamps, poses), tuple(self._mapper.edges))
        return self._mapper.saved(graph)

    def _restore(self, before: SavedMap) -> None:
        self._mapper.restore(before)
        for keyframe in self._mapper.keyframes:
            self._optimiser.add(keyframe.number, keyframe.T_odom_camera)
        self._update(before.graph.edges)
        self.T_map_odom = None

    def _add(self, keyframes: Sequence[tuple[int, Keyed]]) -> None:
        """Adds keyframes that are linked to one another or to the map."""
        T_map_odom = self.T_map_odom
        assert T_map_odom is not None  # noqa: S101 - for the type checker
        edges: list[PoseGraphEdge] = []
        for number, keyed in keyframes:
            row = self._rows[number] = len(self._mapper.keyframes)
            self._optimiser.add(row, T_map_odom @ keyed.T_odom_camera)
            known = tuple(
                replace(edge, parent=self._rows[edge.parent], child=row)
                for edge in keyed.edges
                if edge.parent in self._rows
            )
            self._mapper.add_edges(known)
            loops = self._mapper.add(self._keyframe(row, keyed), self._config)
            self.loops += len(loops)
            edges += (*known, *loops)
        self._update(edges)
        newest = self._mapper.keyframes[-1]
        near = self._mapper.compare_near(newest, self.poses)
        if near:
            self._update(near)
        self.loops += len(near)
        self.T_map_odom = self.poses[newest.number] @ se3.inverse(newest.T_odom_camera)

    def add_edge(self, edge: PoseGraphEdge) -> None:
        """Adds a later edge between known keyframes."""
        if edge.parent in self._rows and edge.child in self._rows:
            parent, child = self._rows[edge.parent], self._rows[edge.child]
            moved = replace(edge, parent=parent, child=child)
            self._mapper.add_edges((moved,))
            self._update((moved,))

    def _update(self, edges: Iterable[PoseGraphEdge]) -> None:
        for edge in edges:
            self._optimiser.add_edge(edge)
        self.poses = self._optimiser.update()

    def _keyframe(self, row: int, keyed: Keyed) -> MapKeyframe:
        view = view_of(keyed.frame, self._config.camera)
        T, stamp_ns = keyed.T_odom_camera, keyed.frame.stamp_ns
        return MapKeyframe.seen(row, stamp_ns, T, view, self._glue, self._config)
