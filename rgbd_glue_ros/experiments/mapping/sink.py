"""Collects what a map is made of while the odometry runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter

from rgbd_glue_ros.experiments.replay.run_record import Run
from rgbd_glue_ros.live.extrinsics import Extrinsics
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.slam.cloud import ColoredCloud, cloud_of
from rgbd_glue_ros.slam.map_file import SavedMap
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.slam.mapper import Mapper
from rgbd_glue_ros.types import Float64, OdometryEstimate, PoseGraph, RgbdFrame, Trajectory


@dataclass
class PartInWork:
    """The map of a part of a recording, between two starts of the odometry.

    Attributes:
        mapper: has its keyframes.
        clouds: of its keyframes, each in its camera's frame.
        up: the upward direction in the first one, a unit vector [3]; None without an accelerometer.
    """

    mapper: Mapper
    clouds: list[ColoredCloud] = field(default_factory=list)
    up: Float64 | None = None

    def saved(self, graph: PoseGraph) -> SavedMap:
        """The map for a file: in the frame of the given map; of a new one z is up.

        The camera is assumed to start level where there is no accelerometer, as by the node.

        Args:
            graph: the optimum, with all keyframes.
        """
        if self.mapper.session_start > 0:
            return self.mapper.saved(graph)
        axes = Extrinsics.of_camera("body")
        T_map_odom = (axes if self.up is None else axes.levelled(self.up)).T_fixed_odom
        in_odom = graph.keyframes
        in_map = Trajectory(in_odom.stamps_ns, T_map_odom @ in_odom.poses)
        return self.mapper.saved(replace(graph, keyframes=in_map))


class MappingSink:
    """Passes the keyframes of an odometry to a mapper, and keeps their clouds.

    Where the odometry starts anew, so does the map.

    Attributes:
        ms: time spent on each keyframe, milliseconds.
    """

    def __init__(self, odometry: Odometry, new_mapper: Callable[[], Mapper]) -> None:
        self._odometry = odometry
        self._new_mapper = new_mapper
        self._parts = [PartInWork(new_mapper())]
        self.ms: list[float] = []

    def start_anew(self) -> None:
        """Begins another map."""
        self._parts.append(PartInWork(self._new_mapper()))

    def longest(self, run: Run) -> PartInWork:
        """The longest part of a run."""
        return self._parts[run.longest_row]

    def add(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Adds a frame."""
        part = self._parts[-1]
        start_row = part.mapper.session_start
        part.mapper.add_edges(
            tuple(
                replace(edge, parent=start_row + edge.parent, child=start_row + edge.child)
                for edge in estimate.edges
            )
        )
        keyframe = self._odometry.newest_keyframe
        if not estimate.is_keyframe or keyframe is None or estimate.T_odom_camera is None:
            return
        start = perf_counter()
        kept = MapKeyframe.of(keyframe, estimate.T_odom_camera)
        kept = replace(kept, row=start_row + kept.row)
        part.mapper.reconfigure(self._odometry.learnt_config())
        part.mapper.add(kept)
        self.ms.append(1000 * (perf_counter() - start))
        if not part.clouds:
            part.up = self._odometry.up(frame.stamp_ns)
        part.clouds.append(cloud_of(frame))

    def close(self) -> None:
        """Does nothing: the map is built at the end."""
