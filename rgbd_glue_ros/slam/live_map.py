"""A map that grows while the odometry runs elsewhere: keyframes and edges in, corrections out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import grey, rectified
from rgbd_glue_ros.geometry.depth import limit_depth
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam.appearance import SearchTree
from rgbd_glue_ros.slam.incremental import IncrementalOptimiser
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.slam.mapper import Mapper
from rgbd_glue_ros.types import Float64, PoseGraphEdge, RgbdFrame, View


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
    """Closes loops as keyframes come.

    Attributes:
        poses: T_map_camera [4, 4] of every keyframe, by its row.
        loops: how many were closed.
    """

    def __init__(self, config: Config) -> None:
        """An empty map.

        Raises:
            MissingExtraError: the libraries of the extra slam are not installed.
        """
        self._config = config
        self._glue = Glue(config)
        self.clear()

    def clear(self) -> None:
        """Begins anew."""
        self._mapper = Mapper(self._config, SearchTree())
        self._optimiser = IncrementalOptimiser()
        self._rows: dict[int, int] = {}
        self.poses: dict[int, Float64] = {}
        self.loops = 0
        self.T_map_odom: Float64 = np.eye(4)

    def add(self, number: int, keyed: Keyed) -> None:
        """Takes a keyframe with its edges.

        Without an edge to a keyframe that is known, as of the first, it is held where the
        odometry has it.

        Args:
            number: the odometry's.
            keyed: the keyframe.
        """
        row = self._rows[number] = len(self._mapper.keyframes)
        T = self.T_map_odom @ keyed.T_odom_camera
        known = tuple(
            replace(edge, parent=self._rows[edge.parent], child=row)
            for edge in keyed.edges
            if edge.parent in self._rows
        )
        self._optimiser.add(row, T)
        self._mapper.add_edges(known)
        loops = self._mapper.add(self._keyframe(row, keyed), self._config.refine)
        self._update((*known, *loops))
        newest = self._mapper.keyframes[-1]
        near = self._mapper.compare_near(newest, self.poses)
        if near:
            self._update(near)
        self.loops += len(loops) + len(near)
        self.T_map_odom = self.poses[row] @ se3.inverse(keyed.T_odom_camera)

    def add_edge(self, edge: PoseGraphEdge) -> None:
        """Takes an edge that came later, between keyframes that are known."""
        if edge.parent in self._rows and edge.child in self._rows:
            parent, child = self._rows[edge.parent], self._rows[edge.child]
            moved = replace(edge, parent=parent, child=child)
            self._mapper.add_edges((moved,))
            self._update((moved,))

    def _update(self, edges: tuple[PoseGraphEdge, ...]) -> None:
        for edge in edges:
            self._optimiser.add_edge(edge)
        self.poses = self._optimiser.update()

    def _keyframe(self, row: int, keyed: Keyed) -> MapKeyframe:
        frame = rectified(keyed.frame)
        depth = limit_depth(frame.depth, self._config.camera)
        view = View(grey(frame.color), depth, frame.intrinsics)
        model = model_of(view, self._config.refine.grid_step)
        features = self._glue.extract(view)
        return MapKeyframe(row, frame.stamp_ns, keyed.T_odom_camera, features, model)
