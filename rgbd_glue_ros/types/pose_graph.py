"""Keyframes and the measurements between them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from rgbd_glue_ros.types.arrays import Float64
from rgbd_glue_ros.types.trajectory import Trajectory


class EdgeOrigin(Enum):
    """What measured the transform between two keyframes."""

    TRACKING = "the child was tracked from the parent"
    ASSUMED = (
        "nothing: the camera was lost in between, and the covariance says how far it may have moved"
    )
    REVISIT = (
        "the child, or a frame tracked from it, saw again what the parent, a much earlier one, had "
        "seen"
    )
    LOOP = "recognised by appearance and verified by registration"


@dataclass(frozen=True, eq=False)
class PoseGraphEdge:
    """A measured transform between two keyframes.

    Attributes:
        parent: number of the keyframe whose frame the transform maps to.
        child: number of the keyframe whose frame it maps from.
        T_parent_child: float64 [4, 4].
        covariance: float64 [6, 6] of T_parent_child (x y z rx ry rz; m, rad; perturbation on the
            left, in the parent's frame), positive definite.
        origin: what measured it.
    """

    parent: int
    child: int
    T_parent_child: Float64
    covariance: Float64
    origin: EdgeOrigin = EdgeOrigin.TRACKING


@dataclass(frozen=True)
class PoseGraph:
    """Keyframes and the measurements between them.

    Attributes:
        keyframes: T_odom_camera of every keyframe.
        edges: between rows of ``keyframes``.
    """

    keyframes: Trajectory
    edges: tuple[PoseGraphEdge, ...]
