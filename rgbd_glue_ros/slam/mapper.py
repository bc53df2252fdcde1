"""The map of a recording: keyframes and loops as they come, and the optimum at the end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.slam.loop_closure import T_map_odom_by
from rgbd_glue_ros.slam.loop_finder import LoopFinder, is_of_a_loop, linked_to
from rgbd_glue_ros.slam.map_file import SavedMap
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.slam.optimiser import Optimum, optimise
from rgbd_glue_ros.slam.stored_keyframe import StoredKeyframe
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraph, PoseGraphEdge, Trajectory


class Mapper:
    """Collects the keyframes and edges of an odometry, and closes loops.

    Attributes:
        edges: of the odometry and of loops.
    """

    def __init__(self, finder: LoopFinder) -> None:
        """An empty map.

        Args:
            finder: compares keyframes, and has none yet.
        """
        self._finder = finder
        self._before_name = ""
        self.edges: list[PoseGraphEdge] = []

    @property
    def session_start(self) -> int:
        """Number of the first keyframe that is not from a given map."""
        return self._finder.session_start

    @property
    def keyframes(self) -> list[StoredKeyframe]:
        """All keyframes so far, by number."""
        return self._finder.keyframes

    def restore(self, saved: SavedMap) -> None:
        """Adds a given map, first; later keyframes belong to another session.

        Until a loop links them, the pose between the two is unknown.
        """
        self._finder.restore(saved)
        self.edges += saved.graph.edges
        self._before_name = saved.name

    def reconfigure(self, config: Config) -> None:
        """Compares keyframes with what the odometry knows about the camera so far."""
        self._finder.reconfigure(config)

    def add_edges(self, edges: tuple[PoseGraphEdge, ...]) -> None:
        """Adds edges measured by the odometry, except those between keyframes of a loop."""
        self.edges += [edge for edge in edges if not is_of_a_loop(edge, self.edges)]

    def add(self, keyframe: MapKeyframe) -> None:
        """Adds a keyframe of the odometry, whose number is the next one, and closes its loops."""
        stored = self._finder.tracked(keyframe)
        # so that it has its number whatever becomes of the search
        self._finder.add([stored])
        self.edges += self._finder.compare_and_index(stored, linked_to(stored.row, self.edges))

    def T_map_odom(self) -> Float64 | None:
        """The pose of this session's odom frame in a given map, float64 [4, 4].

        The identity without such a map; None as long as no loop links the two.
        """
        start = self.session_start
        if start == 0:
            return np.eye(4)
        link = next((e for e in self.edges if e.parent < start <= e.child), None)
        if link is None:
            return None
        parent, child = self.keyframes[link.parent], self.keyframes[link.child]
        return T_map_odom_by(link, parent.T_odom_camera, child.T_odom_camera)

    @property
    def graph(self) -> PoseGraph:
        """The pose graph, with poses as the odometry published them, placed in the map.

        Raises:
            InputError: no loop links this session to the given map.
        """
        T_map_odom = self.T_map_odom()
        if T_map_odom is None:
            raise InputError(
                self._before_name,
                "shows none of the places of this recording",
                "give the map of this place, or none",
            )
        stamps = np.array([keyframe.stamp_ns for keyframe in self.keyframes], np.int64)
        poses = np.array([keyframe.T_odom_camera for keyframe in self.keyframes])
        poses = poses.reshape(-1, 4, 4)
        poses[self.session_start :] = T_map_odom @ poses[self.session_start :]
        return PoseGraph(Trajectory(stamps, poses), tuple(self.edges))

    def saved(self, graph: PoseGraph) -> SavedMap:
        """The map for a file, with the poses of ``graph``, which has all keyframes."""
        return SavedMap(graph, self._finder.views)

    def finish(self) -> Optimum:
        """The optimum, after also comparing keyframes that it places near each other.

        Without a loop the poses are unchanged: the odometry knew all other edges.
        """
        first = optimise(self.graph)
        poses = dict(enumerate(first.graph.keyframes.poses))
        for keyframe in self.keyframes:
            linked = linked_to(keyframe.row, self.edges)
            self.edges += self._finder.loops_near(keyframe, poses, linked)
        if not any(edge.origin is EdgeOrigin.LOOP for edge in self.edges):
            return replace(first, graph=self.graph)
        return optimise(self.graph)
