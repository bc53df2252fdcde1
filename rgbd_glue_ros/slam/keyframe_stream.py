"""Reassembles keyframes whose poses and edges arrive on two topics, in any order."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any

from rgbd_glue_ros.files.stamp_text import format_stamp
from rgbd_glue_ros.live.topics import KEYFRAME_EDGES, KEYFRAME_POSE
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraphEdge

logger = logging.getLogger(__name__)

MOST_WAITING = 100
"""Poses that wait for their edges, and edges that wait for their poses, of each at most: as many
as one of the two topics may be ahead of the other."""


@dataclass(frozen=True)
class NewKeyframe:
    """A complete keyframe.

    Attributes:
        number: the odometry's number.
        stamp_ns: of its image.
        T_odom_child: float64 [4, 4], as published.
        edge: to the one that it was tracked from; None for the first of a graph.
        is_anew: whether a new graph begins with it of which nobody has said so.
    """

    number: int
    stamp_ns: int
    T_odom_child: Float64
    edge: PoseGraphEdge | None = None
    is_anew: bool = False


class KeyframeStream:
    """Numbers the keyframes by the edges that name them.

    The odometry says when a graph begins. Where that was lost, or came before somebody listened,
    numbers that begin again show it, but not before the second keyframe. If a message is lost, its
    counterpart waits in vain; the oldest are dropped.
    """

    def __init__(self) -> None:
        self._poses: dict[int, Float64] = {}
        self._edges: dict[int, PoseGraphEdge] = {}
        self._stamps: dict[int, int] = {}
        self._newest_ns: int | None = None
        self._missed: set[str] = set()

    @property
    def awaited_ns(self) -> tuple[int, ...]:
        """Stamps of the keyframes whose edges are most likely to come: the two newest.

        Where nobody said that a graph begins, its first has no edge until the second has one.
        """
        return tuple(self._poses)[-2:]

    @property
    def waiting(self) -> int:
        """Number of poses and edges that wait for their counterparts."""
        return len(self._poses) + len(self._edges)

    def begin(self, stamp_ns: int) -> list[NewKeyframe]:
        """Begins a graph.

        Args:
            stamp_ns: of its first keyframe, which has the number 0.

        Returns:
            That keyframe, if its pose has come already.
        """
        T_odom_child = self._poses.get(stamp_ns)
        if T_odom_child is None and self._newest_ns is not None and stamp_ns < self._newest_ns:
            # time went back
            self._poses, self._newest_ns = {}, None
        self._poses = {at: T for at, T in self._poses.items() if at > stamp_ns}
        self._edges, self._stamps = {}, {0: stamp_ns}
        return [] if T_odom_child is None else [NewKeyframe(0, stamp_ns, T_odom_child)]

    def add_pose(self, stamp_ns: int, T_odom_child: Float64) -> list[NewKeyframe]:
        """Adds the pose [4, 4] of a keyframe; returns the keyframes that are now complete.

        If time went back, as with a bag in a loop, the odometry has restarted. Numbers and stamps
        may then repeat, so they do not show it.
        """
        if self._newest_ns is not None and stamp_ns < self._newest_ns:
            self._poses, self._edges, self._stamps = {}, {}, {}
        self._newest_ns = stamp_ns
        if self._stamps.get(0) == stamp_ns:
            return [NewKeyframe(0, stamp_ns, T_odom_child)]
        self._poses[stamp_ns] = T_odom_child
        edge = self._edges.pop(stamp_ns, None)
        if edge is None:
            self._leave_out_oldest(self._poses, KEYFRAME_EDGES, "edge")
            return []
        return self._completed(stamp_ns, edge)

    def add_edge(
        self, stamp_ns: int, edge: PoseGraphEdge
    ) -> tuple[list[NewKeyframe], PoseGraphEdge | None]:
        """Adds an edge.

        Args:
            stamp_ns: stamp of its child.
            edge: with the odometry's numbers.

        Returns:
            The keyframes that are now complete; and the edge as a revisit, if its child already
            was.
        """
        if self._stamps.get(edge.child) == stamp_ns:
            # a message has no origin, but the odometry publishes the edge of tracking first
            return [], replace(edge, origin=EdgeOrigin.REVISIT)
        if stamp_ns not in self._poses:
            # a revisit that is ahead of the pose is left out, not taken for the edge of tracking
            self._edges.setdefault(stamp_ns, edge)
            self._leave_out_oldest(self._edges, KEYFRAME_POSE, "pose")
            return [], None
        return self._completed(stamp_ns, edge), None

    def _leave_out_oldest(self, waiting: dict[int, Any], topic: str, missing: str) -> None:
        """Bounds what waits for messages of a topic, and says once what did not come."""
        if len(waiting) <= MOST_WAITING:
            return
        oldest_ns = next(iter(waiting))
        del waiting[oldest_ns]
        if topic not in self._missed:
            self._missed.add(topic)
            logger.warning(
                "%s: the %s of the keyframe at %s s did not come while %d others did not either: "
                "it is left out of the map. Messages are lost on the way, or two odometries "
                "publish (logged once)",
                *(topic, missing, format_stamp(oldest_ns), MOST_WAITING),
            )

    def _completed(self, stamp_ns: int, edge: PoseGraphEdge) -> list[NewKeyframe]:
        if self._precedes_the_graph(stamp_ns):
            del self._poses[stamp_ns]
            return []
        is_anew = self._begins_a_graph(edge.child, stamp_ns)
        keyframes = []
        if is_anew:
            self._stamps = {}
            first = self._first_before(stamp_ns)
            if first is not None:
                self._stamps[edge.parent] = first
                T = self._poses.pop(first)
                keyframes.append(NewKeyframe(edge.parent, first, T, is_anew=True))
        self._stamps[edge.child] = stamp_ns
        is_first = is_anew and not keyframes
        T = self._poses.pop(stamp_ns)
        keyframes.append(
            NewKeyframe(edge.child, stamp_ns, T, None if is_first else edge, is_anew=is_first)
        )
        return keyframes

    def _precedes_the_graph(self, stamp_ns: int) -> bool:
        """Whether a keyframe comes so late that another graph has begun."""
        first_ns = next(iter(self._stamps.values()), stamp_ns)
        return stamp_ns < first_ns

    def _begins_a_graph(self, number: int, stamp_ns: int) -> bool:
        """Whether a keyframe is of another graph than those before.

        Within a graph numbers grow with stamps. A low number with an early stamp comes late.
        """
        newest = max(self._stamps, default=None)
        return newest is None or (number <= newest and stamp_ns > self._stamps[newest])

    def _first_before(self, stamp_ns: int) -> int | None:
        """The stamp of the latest earlier pose without an edge: it begins the graph."""
        return max((stamp for stamp in self._poses if stamp < stamp_ns), default=None)
