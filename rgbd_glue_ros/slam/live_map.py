"""A map that grows while the odometry runs elsewhere: keyframes and edges in, corrections out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam.appearance import SearchTree
from rgbd_glue_ros.slam.edge_composition import SkippedKeyframes, assumed_edge
from rgbd_glue_ros.slam.incremental import IncrementalOptimiser
from rgbd_glue_ros.slam.loop_closure import T_map_odom_by
from rgbd_glue_ros.slam.loop_finder import LoopFinder, is_of_a_loop, linked_to
from rgbd_glue_ros.slam.map_file import OnKeyframe, SavedMap
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.slam.stored_keyframe import StoredKeyframe
from rgbd_glue_ros.slam.waiting_keyframes import UnmappedKeyframe, WaitingKeyframes
from rgbd_glue_ros.types import Float64, PoseGraph, PoseGraphEdge, RgbdFrame, Trajectory


@dataclass(frozen=True)
class PublishedKeyframe:
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

    With an existing map, keyframes wait until one of them shows a place of it. A keyframe with
    which there is no optimum is left out, and the map goes on: every row has a pose.

    Attributes:
        poses: T_map_camera [4, 4] of every keyframe, by its row.
        loops: number of closed loops.
        T_map_odom: float64 [4, 4]; None until a place of the map is recognised.
    """

    def __init__(
        self,
        config: Config,
        before: SavedMap | None = None,
        on_keyframe: OnKeyframe = lambda _done, _total: None,
    ) -> None:
        """Creates a map.

        Args:
            config: how keyframes are compared.
            before: an existing map; None starts an empty one.
            on_keyframe: called after each keyframe of that map.

        Raises:
            MissingExtraError: the libraries of the extra slam are not installed.
        """
        self._config = config
        self._before = before
        self._glue = Glue(config)
        self._finder = LoopFinder(config, self._glue, SearchTree)
        self._waiting = WaitingKeyframes("" if before is None else before.name)
        if before is not None:
            self._finder.restore(before, on_keyframe)
        self._begin()

    def _begin(self) -> None:
        # first, since others read it meanwhile
        self.T_map_odom: Float64 | None = np.eye(4) if self._before is None else None
        self._finder.forget_session()
        self._edges: list[PoseGraphEdge] = []
        self._optimiser = IncrementalOptimiser()
        self._rows: dict[int, int] = {}
        self._skipped = SkippedKeyframes()
        self._waiting.clear()
        self.poses: dict[int, Float64] = {}
        self.loops = 0
        if self._before is not None:
            graph = self._before.graph
            self._solve(graph.edges, dict(enumerate(graph.keyframes.poses)))
            self._edges += graph.edges

    def clear(self) -> None:
        """Starts over, from the existing map if there is one."""
        # locating does not change the map
        if self._rows or len(self._waiting) or len(self._skipped):
            self._begin()
        elif self._before is not None:
            self.T_map_odom = None

    @property
    def given(self) -> SavedMap | None:
        """The existing map; None if it began empty."""
        return self._before

    @property
    def session_keyframes(self) -> int:
        """Number of keyframes added, also of those that wait for a place of an existing map."""
        return len(self._rows) + len(self._waiting)

    @property
    def waiting_keyframes(self) -> int:
        """Number of keyframes that are not in the map: none shows a place of the existing one."""
        return len(self._waiting)

    @property
    def is_placed(self) -> bool:
        """Whether the pose of ``odom`` in the map is known."""
        return self.T_map_odom is not None

    def add(self, number: int, keyed: PublishedKeyframe) -> None:
        """Adds a keyframe with its edges.

        Edges over keyframes that were skipped are composed. Without an edge to a keyframe that is
        known, one from the keyframe before is assumed, from their odometry poses.

        Args:
            number: the odometry's.
            keyed: the keyframe.

        Raises:
            InputError: its images cannot be compared (its edges are kept), or no optimum exists
                with it (it is left out) or with what links those that wait to the map (they wait
                for another such link).
        """
        try:
            keyframe = self._keyframe(keyed)
        except Exception:
            self.skip(number, keyed.edges)
            raise
        new = UnmappedKeyframe(number, self._finder.seen(keyframe), keyed.edges)
        if self._is_joined:
            self._add([new])
            return
        # such a one would keep all that wait from the map
        self._optimiser.check(keyed.edges)
        self._waiting.add(new)
        loops = self._finder.recognised(keyframe)
        if loops:
            waiting = self._waiting.numbered(len(self._finder.keyframes))
            row = waiting[-1].keyframe.row
            self._add(waiting, tuple(replace(loop, child=row) for loop in loops))

    @property
    def _is_joined(self) -> bool:
        """Whether keyframes need not wait."""
        return self._before is None or bool(self._rows)

    def skip(self, number: int, edges: tuple[PoseGraphEdge, ...]) -> None:
        """Keeps the edges of a keyframe without images.

        Args:
            number: the odometry's.
            edges: to earlier keyframes, by the odometry's numbers; the first leads from it to
                those that come.
        """
        if edges:
            self._skipped.add(number, edges[0])

    def locate(self, keyed: PublishedKeyframe) -> bool:
        """Searches for a keyframe among those of the map, which is not changed.

        Returns:
            Whether it was found; ``T_map_odom`` is then that of the keyframe.
        """
        keyframe = self._keyframe(keyed)
        loops = self._finder.recognised(keyframe)
        if not loops:
            return False
        self.T_map_odom = self._T_map_odom(loops[0], keyframe.T_odom_camera)
        return True

    def stamps_ns(self) -> dict[int, int]:
        """Stamps of the keyframes by their rows."""
        return {keyframe.row: keyframe.stamp_ns for keyframe in self._finder.keyframes}

    def saved(self) -> SavedMap:
        """The current map, for a file."""
        keyframes = self._finder.keyframes
        stamps = np.array([keyframe.stamp_ns for keyframe in keyframes], np.int64)
        poses = np.array([self.poses[row] for row in range(len(keyframes))]).reshape(-1, 4, 4)
        graph = PoseGraph(Trajectory(stamps, poses), tuple(self._edges))
        return SavedMap(graph, self._finder.views)

    def _add(self, new: Sequence[UnmappedKeyframe], links: tuple[PoseGraphEdge, ...] = ()) -> None:
        """Adds keyframes that are linked to one another or to the map.

        Args:
            new: their rows are the next ones.
            links: loops of the last of them with the existing map.
        """
        newest = new[-1].keyframe
        T_map_odom = self._T_map_odom(links[0], newest.T_odom_camera) if links else self.T_map_odom
        assert T_map_odom is not None  # noqa: S101 - for the type checker
        try:
            edges = (*self._edges_by_rows(new), *links)
            self._solve(edges, {n.keyframe.row: T_map_odom @ n.keyframe.T_odom_camera for n in new})
        except Exception:
            # edges to them would lead to no keyframe, or to the same failure again
            for n in new:
                self._rows.pop(n.number, None)
            raise
        self._waiting.clear()
        self._edges += edges
        self._finder.add([n.keyframe for n in new])
        self.loops += len(links)
        try:
            self._close_loops([n.keyframe for n in new])
        finally:
            self._place_odom()

    def _place_odom(self) -> None:
        """Takes the pose of odom where the newest keyframe now is."""
        newest = self._finder.keyframes[-1]
        self.T_map_odom = self.poses[newest.row] @ se3.inverse(newest.T_odom_camera)

    def _close_loops(self, added: Sequence[StoredKeyframe]) -> None:
        """Closes loops of keyframes that were added, and of the last with those near it."""
        with ExitStack() as searches:
            # from the last to the first of these calls, each even if another fails
            searches.callback(self._close_near, added[-1])
            for keyframe in reversed(added):
                searches.callback(self._close_alike, keyframe)

    def _close_alike(self, keyframe: StoredKeyframe) -> None:
        self._close(self._finder.compare_and_index(keyframe, self._linked_to(keyframe)))

    def _close_near(self, keyframe: StoredKeyframe) -> None:
        self._close(self._finder.loops_near(keyframe, self.poses, self._linked_to(keyframe)))

    def _linked_to(self, keyframe: StoredKeyframe) -> set[int]:
        return linked_to(keyframe.row, self._edges)

    def _edges_by_rows(self, new: Sequence[UnmappedKeyframe]) -> list[PoseGraphEdge]:
        """The edges from new keyframes to earlier ones, by rows; registers the rows."""
        found: list[PoseGraphEdge] = []
        before = self._finder.keyframes[self._finder.session_start :][-1:]
        for n in new:
            row = self._rows[n.number] = n.keyframe.row
            known = [edge for edge in map(self._by_rows, n.edges) if edge is not None]
            if before and all(edge.child != row for edge in known):
                known.append(_assumed(before[-1], n.keyframe))
            found += known
            before = [n.keyframe]
        return found

    def _by_rows(self, edge: PoseGraphEdge) -> PoseGraphEdge | None:
        """An edge between the odometry's numbers as one between rows; None where it has none."""
        known = self._skipped.bridged(edge, self._rows)
        if known is None:
            return None
        return replace(known, parent=self._rows[known.parent], child=self._rows[known.child])

    def add_edge(self, edge: PoseGraphEdge) -> None:
        """Adds a later edge between keyframes that are known, wait or were skipped.

        One between keyframes of a loop is left out.

        Raises:
            InputError: there is no optimum with it; it is left out.
        """
        if not self._is_joined:
            self._optimiser.check([edge])
            self._waiting.add_edge(edge)
            return
        known = self._by_rows(edge)
        if known is not None and not is_of_a_loop(known, self._edges):
            self._solve((known,))
            self._edges.append(known)
            self._place_odom()

    def _close(self, loops: tuple[PoseGraphEdge, ...]) -> None:
        """Adds loops that were found; they are left out if there is no optimum with them."""
        if not loops:
            return
        self._solve(loops)
        self._edges += loops
        self.loops += len(loops)

    def _solve(
        self,
        edges: Iterable[PoseGraphEdge],
        keyframes: Mapping[int, Float64] = MappingProxyType({}),
    ) -> None:
        """Finds the optimum with further keyframes [4, 4], by their rows, and edges; or fails."""
        for row, T_map_camera in keyframes.items():
            self._optimiser.add(row, T_map_camera)
        for edge in edges:
            self._optimiser.add_edge(edge)
        self.poses = self._optimiser.update()

    def _T_map_odom(self, loop: PoseGraphEdge, T_odom_camera: Float64) -> Float64:
        """The pose of odom in the map according to a loop with it, float64 [4, 4]."""
        return T_map_odom_by(loop, self.poses[loop.parent], T_odom_camera)

    def _keyframe(self, keyed: PublishedKeyframe) -> MapKeyframe:
        """A keyframe whose row is the next one."""
        row = len(self._finder.keyframes)
        view = view_of(keyed.frame, self._config.camera)
        T, stamp_ns = keyed.T_odom_camera, keyed.frame.stamp_ns
        return MapKeyframe.seen(row, stamp_ns, T, view, self._glue, self._config)


def _assumed(before: StoredKeyframe, keyframe: StoredKeyframe) -> PoseGraphEdge:
    """In place of an edge that is not known: where the odometry has both."""
    T = se3.inverse(before.T_odom_camera) @ keyframe.T_odom_camera
    elapsed_ns = keyframe.stamp_ns - before.stamp_ns
    return assumed_edge(before.row, keyframe.row, T, elapsed_ns)
