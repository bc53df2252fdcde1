"""Edges over keyframes that the map does not have, and edges in place of those never measured."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.speeds import lost_covariance
from rgbd_glue_ros.types import NANOSECONDS, EdgeOrigin, Float64, PoseGraphEdge

# The least doubtful first: a composed edge is as doubtful as the worse of the two.
_BY_DOUBT = (EdgeOrigin.TRACKING, EdgeOrigin.ASSUMED, EdgeOrigin.REVISIT, EdgeOrigin.LOOP)
# Two stamps may be equal or in the wrong order, and a covariance has to be positive definite.
_LEAST_GAP_NS = NANOSECONDS // 30


def composed(first: PoseGraphEdge, second: PoseGraphEdge) -> PoseGraphEdge:
    """The edge from the first's parent a over its child b to the second's child c.

    exp(x) T_a_b exp(y) T_b_c is exp(x) exp(Ad(T_a_b) y) T_a_c, so to the first order the
    covariances add up in the frame of a, where both errors are independent.

    Args:
        first: from a to b.
        second: from b to c.
    """
    T_a_b = first.T_parent_child
    covariance = first.covariance + se3.transported_covariance(T_a_b, second.covariance)
    origin = max(first.origin, second.origin, key=_BY_DOUBT.index)
    return PoseGraphEdge(
        first.parent, second.child, T_a_b @ second.T_parent_child, covariance, origin
    )


def reversed_edge(edge: PoseGraphEdge) -> PoseGraphEdge:
    """The same measurement from the child to the parent.

    The inverse of exp(x) T is exp(-Ad(T^-1) x) T^-1.
    """
    T_child_parent = se3.inverse(edge.T_parent_child)
    return replace(
        edge,
        parent=edge.child,
        child=edge.parent,
        T_parent_child=T_child_parent,
        covariance=se3.transported_covariance(T_child_parent, edge.covariance),
    )


def assumed_edge(
    parent: int, child: int, T_parent_child: Float64, elapsed_ns: int
) -> PoseGraphEdge:
    """An edge that nobody measured, as doubtful as a pose that was lost for as long.

    Args:
        parent: number of the keyframe before.
        child: number of the keyframe.
        T_parent_child: float64 [4, 4], where the odometry has the two.
        elapsed_ns: between their stamps, nanoseconds.
    """
    in_child = lost_covariance(max(abs(elapsed_ns), _LEAST_GAP_NS) / NANOSECONDS)
    covariance = se3.transported_covariance(T_parent_child, in_child)
    return PoseGraphEdge(parent, child, T_parent_child, covariance, EdgeOrigin.ASSUMED)


class SkippedKeyframes:
    """Keyframes that the map does not have, each with its edge from the one before.

    Where several edges lead over the same keyframe, each contains its edge, so that their errors
    are alike to that degree; they are taken as independent.
    """

    def __init__(self) -> None:
        self._edges: dict[int, PoseGraphEdge] = {}

    def __len__(self) -> int:
        return len(self._edges)

    def add(self, number: int, edge: PoseGraphEdge) -> None:
        """Takes a keyframe by its number, and the edge that ends at it."""
        self._edges[number] = edge

    def bridged(self, edge: PoseGraphEdge, known: Container[int]) -> PoseGraphEdge | None:
        """The edge between keyframes that the map has, composed over skipped ones.

        Args:
            edge: by numbers of keyframes.
            known: the numbers of those that the map has.

        Returns:
            An edge between two of them; None where it says nothing of two.
        """
        start = self._from_known(edge, known)
        if start is None:
            return None
        if start.child not in known:
            back = self._edges.get(start.child)
            back = None if back is None else self._from_known(back, known)
            if back is None:
                return None
            start = composed(start, reversed_edge(back))
        return None if start.parent == start.child else start

    def _from_known(self, edge: PoseGraphEdge, known: Container[int]) -> PoseGraphEdge | None:
        """The edge, led back over skipped keyframes to a known one; None if there is none."""
        passed: set[int] = set()
        while edge.parent not in known:
            before = self._edges.get(edge.parent)
            # edges come in messages of others, and may go round in a circle
            if before is None or edge.parent in passed:
                return None
            passed.add(edge.parent)
            edge = composed(before, edge)
        return edge
