"""The optimum of a pose graph, by GTSAM.

Edges of tracking are used as they are. Loops are weighted by their agreement with the rest, by
graduated non-convexity with truncated least squares (Yang, Antonante, Tzoumas and Carlone 2020):
one that contradicts gets the weight 0 and has no effect.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Container, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import MissingExtraError
from rgbd_glue_ros.trajectories.pose_graph import residual_covariance
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraph, PoseGraphEdge, Trajectory

INLIER_PROBABILITY = 0.99
"""A correct loop's residual is below the threshold with this probability."""

TRUSTED = frozenset({EdgeOrigin.TRACKING, EdgeOrigin.ASSUMED})
"""Origins of edges that cannot confuse one place with another."""

# GTSAM has rotation before translation
_ROTATION_FIRST = np.array([3, 4, 5, 0, 1, 2])
# a tenth of a millimetre: if tighter, solvers run out of digits over hundreds of keyframes
_FIXED_SIGMA = 1e-4


@dataclass(frozen=True)
class Optimum:
    """A pose graph at its optimum.

    Attributes:
        graph: with optimised poses; the first is unchanged.
        weights: float64 [E], of its edges, 0 for a rejected one.
        chi_squared: sum of the accepted edges' squared Mahalanobis distances.
    """

    graph: PoseGraph
    weights: Float64
    chi_squared: float

    @property
    def accepted(self) -> PoseGraph:
        """The graph without the rejected edges: with the others it is at its optimum."""
        edges = zip(self.graph.edges, self.weights, strict=True)
        return replace(self.graph, edges=tuple(edge for edge, weight in edges if weight > 0.5))

    @property
    def degrees_of_freedom(self) -> int:
        """Accepted measurements minus unknowns."""
        return 6 * (len(self.accepted.edges) - len(self.graph.keyframes) + 1)


def load_gtsam(purpose: str = "the optimum of a pose graph") -> Any:
    """Imports and returns GTSAM.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import gtsam  # noqa: PLC0415
    except ImportError as error:
        raise MissingExtraError("gtsam", "slam", purpose) from error
    return gtsam


def unlinked(
    keyframes: Iterable[int], edges: Iterable[PoseGraphEdge], known: Container[int]
) -> list[int]:
    """Those of some keyframes that no chain of edges links to a known one: they have no optimum."""
    neighbours: defaultdict[int, list[int]] = defaultdict(list)
    for edge in edges:
        neighbours[edge.parent].append(edge.child)
        neighbours[edge.child].append(edge.parent)
    reached = {end for end in neighbours if end in known}
    frontier = list(reached)
    while frontier:
        found = set(neighbours[frontier.pop()]) - reached
        reached |= found
        frontier += found
    return [k for k in keyframes if k not in reached and k not in known]


def between_factor(gtsam: Any, edge: PoseGraphEdge) -> Any:
    """An edge as GTSAM's ``BetweenFactorPose3``, with numbers of keyframes as keys."""
    covariance = residual_covariance(edge)[np.ix_(_ROTATION_FIRST, _ROTATION_FIRST)]
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    T = gtsam.Pose3(edge.T_parent_child)
    return gtsam.BetweenFactorPose3(edge.parent, edge.child, T, noise)


def fixed_factor(gtsam: Any, key: int, T: Float64) -> Any:
    """Fixes a keyframe at its pose."""
    noise = gtsam.noiseModel.Isotropic.Sigma(6, _FIXED_SIGMA)
    return gtsam.PriorFactorPose3(key, gtsam.Pose3(T), noise)


def factor_graph(gtsam: Any, graph: PoseGraph) -> Any:
    """The ``NonlinearFactorGraph``: the first keyframe fixed, then a factor for every edge."""
    factors = gtsam.NonlinearFactorGraph()
    factors.add(fixed_factor(gtsam, 0, graph.keyframes.poses[0]))
    for edge in graph.edges:
        factors.add(between_factor(gtsam, edge))
    return factors


def optimise(graph: PoseGraph) -> Optimum:
    """The most likely poses.

    Args:
        graph: connected, with at least one keyframe.

    Raises:
        MissingExtraError: GTSAM is not installed.
    """
    gtsam = load_gtsam()
    factors = factor_graph(gtsam, graph)
    initial = _values(gtsam, graph.keyframes.poses)
    doubted = [edge.origin not in TRUSTED for edge in graph.edges]
    if any(doubted):
        optimum, weights = _graduated(gtsam, factors, initial, doubted)
    else:
        optimum = gtsam.LevenbergMarquardtOptimizer(factors, initial).optimize()
        weights = np.ones(len(graph.edges))
    poses = np.array([optimum.atPose3(key).matrix() for key in range(len(graph.keyframes))])
    errors = np.array([2 * factors.at(1 + i).error(optimum) for i in range(len(graph.edges))])
    keyframes = Trajectory(graph.keyframes.stamps_ns, poses.reshape(-1, 4, 4))
    return Optimum(replace(graph, keyframes=keyframes), weights, float(weights @ errors))


def _graduated(
    gtsam: Any, factors: Any, initial: Any, doubted: Iterable[bool]
) -> tuple[Any, Float64]:
    """The optimum, and a weight for every edge."""
    params = gtsam.GncLMParams()
    params.setLossType(gtsam.GncLossType.TLS)
    # the first factor fixes the first keyframe
    params.setKnownInliers([0, *(i for i, doubt in enumerate(doubted, 1) if not doubt)])
    optimiser = gtsam.GncLMOptimizer(factors, initial, params)
    optimiser.setInlierCostThresholdsAtProbability(INLIER_PROBABILITY)
    optimum = optimiser.optimize()
    return optimum, np.asarray(optimiser.getWeights(), np.float64)[1:]


def _values(gtsam: Any, poses: Float64) -> Any:
    values = gtsam.Values()
    for key, T in enumerate(poses):
        values.insert(key, gtsam.Pose3(T))
    return values
