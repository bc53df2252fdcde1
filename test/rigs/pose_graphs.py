"""Pose graphs of a camera that wanders about."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraph, PoseGraphEdge, Trajectory

# a centimetre and half a degree, unlike and correlated
_SPREAD = np.diag([0.01, 0.02, 0.005, 0.01, 0.004, 0.008])


def random_covariance(rng: np.random.Generator) -> Float64:
    A = _SPREAD @ (np.eye(6) + 0.3 * rng.normal(0, 1, (6, 6)))
    covariance: Float64 = A @ A.T
    return covariance


def random_edge(rng: np.random.Generator, parent: int, child: int) -> PoseGraphEdge:
    T = se3.exp(rng.normal(0, 1, 6))
    return PoseGraphEdge(parent, child, T, random_covariance(rng), EdgeOrigin.LOOP)


def random_walk(rng: np.random.Generator, length: int) -> Float64:
    """Poses [N, 4, 4] from the identity on, steps of some decimetres."""
    poses = [np.eye(4)]
    for _ in range(length - 1):
        poses.append(poses[-1] @ se3.exp(rng.normal(0, [0.2] * 3 + [0.3] * 3)))
    return np.array(poses)


def random_graph(seed: int, length: int, noise: float = 1.0) -> PoseGraph:
    """Edges between neighbours, and to every third keyframe from six later, with their noise.

    Args:
        seed: the same gives the same.
        length: number of keyframes.
        noise: standard deviations of the noise, in those that the covariances say.
    """
    rng = np.random.default_rng(seed)
    poses = random_walk(rng, length)
    pairs = [(i, i + 1, EdgeOrigin.TRACKING) for i in range(length - 1)]
    pairs += [(i, i + 6, EdgeOrigin.REVISIT) for i in range(0, length - 6, 3)]
    edges = []
    for parent, child, origin in pairs:
        covariance = random_covariance(rng)
        xi = noise * np.linalg.cholesky(covariance) @ rng.normal(0, 1, 6)
        T = se3.exp(xi) @ se3.inverse(poses[parent]) @ poses[child]
        edges.append(PoseGraphEdge(parent, child, T, covariance, origin))
    stamps = np.sort(rng.integers(0, 2**61, length))
    return PoseGraph(Trajectory(stamps, poses), tuple(edges))
