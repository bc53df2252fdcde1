"""Consistency of the covariances of a pose graph with ground truth."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.gates import mahalanobis_squared
from rgbd_glue_ros.trajectories.interpolation import interpolated
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraph, PoseGraphEdge, Trajectory


@dataclass(frozen=True)
class EdgeErrors:
    """Errors of the edges of one origin.

    Attributes:
        count: of the edges whose true transform is known.
        chi2_per_dof: mean squared Mahalanobis distance to the truth, by its six degrees of
            freedom; 1 if covariances are consistent, larger if they are too small.
        median_chi2_per_dof: the median divided by that of chi² with six degrees of freedom; also
            ideally 1.
    """

    count: int
    chi2_per_dof: float
    median_chi2_per_dof: float


# of chi² with six degrees of freedom
_MEDIAN = 5.348


def edge_errors(graph: PoseGraph, reference: Trajectory) -> dict[EdgeOrigin, EdgeErrors]:
    """The errors of the edges of each origin.

    Args:
        graph: the pose graph.
        reference: true poses; between two of them the truth is interpolated.
    """
    truth = interpolated(reference, graph.keyframes.stamps_ns)
    by_origin = {}
    for origin in EdgeOrigin:
        squared = _squared_distances(truth, (e for e in graph.edges if e.origin is origin))
        if len(squared):
            mean, median = float(squared.mean()) / 6, float(np.median(squared)) / _MEDIAN
            by_origin[origin] = EdgeErrors(len(squared), mean, median)
    return by_origin


def _squared_distances(truth: Float64, edges: Iterable[PoseGraphEdge]) -> Float64:
    """Xi' P^-1 xi with xi = log(T_measured T_true^-1), where the truth is known."""
    squared = []
    for edge in edges:
        T_true = se3.inverse(truth[edge.parent]) @ truth[edge.child]
        if np.isfinite(T_true).all():
            xi = se3.log(edge.T_parent_child @ se3.inverse(T_true))
            squared.append(mahalanobis_squared(xi, edge.covariance))
    return np.array(squared, np.float64)
