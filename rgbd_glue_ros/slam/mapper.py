"""Keyframes in, loops and an optimal pose graph out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.features.visual import orb
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam.appearance import Appearance, Likeness
from rgbd_glue_ros.slam.loop_closure import loop_edge
from rgbd_glue_ros.slam.map_file import SavedMap
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.slam.optimiser import Optimum, optimise
from rgbd_glue_ros.slam.packed_view import packed
from rgbd_glue_ros.slam.stored_keyframe import StoredKeyframe, WholeKeyframes
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraph, PoseGraphEdge, Trajectory, UInt8

# Candidates that a keyframe is compared with, by appearance and by proximity: each costs as much as
# tracking a frame.
_MOST_ALIKE, _NEAREST = 2, 2
# Any two images may share fewer descriptors than this.
_MIN_MATCHES = 12
# Keyframes nearer than this, metres and radians added, see the same.
_NEAR = 0.8


class Mapper:
    """Collects keyframes and edges, and closes loops.

    Attributes:
        session_start: number of the first keyframe that is not from an existing map.
        keyframes: all so far, by number.
        edges: of the odometry and of loops.
    """

    def __init__(self, config: Config, glue: Glue, appearance: Appearance) -> None:
        """An empty map.

        Args:
            config: how keyframes are compared.
            glue: registers them, with that configuration.
            appearance: finds similar keyframes.
        """
        self._config = config
        self._glue = glue
        self._appearance = appearance
        self._orb = orb(config.features)
        self._before_name = ""
        self._whole = WholeKeyframes()
        self.session_start = 0
        self.keyframes: list[StoredKeyframe] = []
        self.edges: list[PoseGraphEdge] = []

    def restore(self, saved: SavedMap) -> None:
        """Adds an existing map, first; later keyframes belong to another session.

        Until a loop links them, the pose between the two is unknown.
        """
        keyframes = saved.graph.keyframes
        for stamp_ns, T, view in zip(
            keyframes.stamps_ns.tolist(), keyframes.poses, saved.views, strict=True
        ):
            number = len(self.keyframes)
            keyframe = MapKeyframe.seen(
                number, stamp_ns, T, view.unpacked(), self._glue, self._config
            )
            self._appearance.add(number, self._descriptors(keyframe))
            step = self._config.refine.grid_step
            self.keyframes.append(StoredKeyframe.of_view(keyframe, view, step))
        self.edges += saved.graph.edges
        self._before_name = saved.name
        self.session_start = len(self.keyframes)

    def stored(self, keyframe: MapKeyframe) -> StoredKeyframe:
        """A keyframe that was ``MapKeyframe.seen``, for ``keyframes``."""
        view = packed(keyframe.features.view)
        stored = StoredKeyframe.of_view(keyframe, view, self._config.refine.grid_step)
        # it is compared next
        self._whole.remember(stored, keyframe)
        return stored

    def add_edges(self, edges: tuple[PoseGraphEdge, ...]) -> None:
        """Adds edges measured by the odometry."""
        self.edges += edges

    def remove_edges(self, edges: tuple[PoseGraphEdge, ...]) -> None:
        """Forgets edges that were taken or found, such as those that spoil the optimum."""
        removed = {id(edge) for edge in edges}
        self.edges = [edge for edge in self.edges if id(edge) not in removed]

    def add(self, keyframe: MapKeyframe, config: Config) -> tuple[PoseGraphEdge, ...]:
        """Adds a keyframe of the odometry, and searches for similar places.

        Args:
            keyframe: its number is the next one.
            config: with what the odometry knows about the camera so far.

        Returns:
            The loops found.
        """
        stored = StoredKeyframe.with_model(keyframe)
        self._whole.remember(stored, keyframe)
        # so that it has its number whatever becomes of the search
        self.keyframes.append(stored)
        return self.find_loops(stored, config)

    def find_loops(self, stored: StoredKeyframe, config: Config) -> tuple[PoseGraphEdge, ...]:
        """Searches for loops of a keyframe, and makes it a candidate for later ones.

        Args:
            stored: of ``keyframes``. Call this once for each.
            config: as of ``add``.

        Returns:
            The loops found, which are among ``edges``.
        """
        self._config = config
        keyframe = self._whole.of(stored)
        descriptors = self._descriptors(keyframe)
        alike = self._appearance.like(descriptors)
        self._appearance.add(keyframe.number, descriptors)
        loops = self._loops(keyframe, alike)
        self.edges += loops
        return loops

    def recognised(self, keyframe: MapKeyframe) -> tuple[PoseGraphEdge, ...]:
        """The loops of a keyframe, which is not added, with similar ones."""
        return self._loops(keyframe, self._appearance.like(self._descriptors(keyframe)))

    def _loops(self, keyframe: MapKeyframe, alike: Sequence[Likeness]) -> tuple[PoseGraphEdge, ...]:
        candidates = [
            likeness.number
            for likeness in alike
            if self._is_earlier(likeness.number, keyframe.number)
            and likeness.matches >= _MIN_MATCHES
        ]
        linked = self._linked_to(keyframe.number)
        edges = [
            loop_edge(self._whole.of(self.keyframes[number]), keyframe, self._glue, self._config)
            for number in candidates[:_MOST_ALIKE]
            if number not in linked
        ]
        return tuple(edge for edge in edges if edge is not None)

    def T_map_odom(self) -> Float64 | None:
        """The pose of this session's odom frame in an existing map, float64 [4, 4].

        The identity without such a map; None as long as no loop links the two.
        """
        start = self.session_start
        if start == 0:
            return np.eye(4)
        link = next((e for e in self.edges if e.parent < start <= e.child), None)
        if link is None:
            return None
        T_map_camera = self.keyframes[link.parent].T_odom_camera @ link.T_parent_child
        return np.asarray(
            T_map_camera @ se3.inverse(self.keyframes[link.child].T_odom_camera), np.float64
        )

    @property
    def graph(self) -> PoseGraph:
        """The pose graph, with poses as the odometry published them, placed in the map.

        Raises:
            InputError: no loop links this session to the existing map.
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
        return SavedMap(graph, tuple(keyframe.view for keyframe in self.keyframes))

    def finish(self) -> Optimum:
        """The optimum, after also comparing keyframes that it places near each other.

        Without a loop the poses are unchanged: the odometry knew all other edges.
        """
        first = optimise(self.graph)
        poses = dict(enumerate(first.graph.keyframes.poses))
        for keyframe in self.keyframes:
            self.compare_near(keyframe, poses)
        if not any(edge.origin is EdgeOrigin.LOOP for edge in self.edges):
            return replace(first, graph=self.graph)
        return optimise(self.graph)

    def compare_near(
        self, child: StoredKeyframe, poses: Mapping[int, Float64]
    ) -> tuple[PoseGraphEdge, ...]:
        """Compares a keyframe with the nearest earlier ones that it is not linked to.

        Args:
            child: one of the added keyframes.
            poses: T_map_camera [4, 4] of keyframes by their numbers, including this one.

        Returns:
            The loops found.
        """
        T_child = poses[child.number]
        earlier = [n for n in poses if self._is_earlier(n, child.number)]
        apart = se3.differences(np.array([poses[n] for n in earlier]).reshape(-1, 4, 4), T_child)
        near = [earlier[row] for row in np.argsort(apart, kind="stable") if apart[row] < _NEAR]
        linked = self._linked_to(child.number)
        unlinked = [n for n in near if n not in linked]
        edges = [
            loop_edge(
                self._whole.of(self.keyframes[n]),
                self._whole.of(child),
                self._glue,
                self._config,
                se3.inverse(poses[n]) @ T_child,
            )
            for n in unlinked[:_NEAREST]
        ]
        loops = tuple(edge for edge in edges if edge is not None)
        self.edges += loops
        return loops

    def _is_earlier(self, parent: int, child: int) -> bool:
        """Whether the odometry has not already compared the two.

        It knows its latest keyframes, and none of an existing map.
        """
        start = self.session_start if child >= self.session_start else 0
        return parent < max(start, child - self._config.odometry.window)

    def _linked_to(self, child: int) -> set[int]:
        """The parents of all edges to a keyframe."""
        return {edge.parent for edge in self.edges if edge.child == child}

    def _descriptors(self, keyframe: MapKeyframe) -> UInt8:
        """ORB descriptors [N, 32], strongest first."""
        described = self._orb.extract(keyframe.features.view)
        nothing = np.empty((0, 32), np.uint8)
        return np.asarray(described.descriptors, np.uint8) if len(described.uv) else nothing
