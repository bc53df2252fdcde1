"""MAC: 3D registration with maximal cliques (Zhang, Yang, Zhang and Zhang, CVPR 2023).

Matches are nodes, joined if they are compatible. A set of mutually compatible matches that cannot
be enlarged is a maximal clique; each gives a transform, and the best one is used.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import MissingExtraError
from rgbd_glue_ros.geometry.fitting import distances, procrustes
from rgbd_glue_ros.registration.compatibility import length_differences
from rgbd_glue_ros.types import Correspondences, Float32, Float64

_COMPATIBILITY_M = 0.1
_LEAST_COMPATIBILITY = 0.99
_INLIER_M = 0.1
# Cliques grow exponentially with the edges of a graph: the publication thins dense graphs too.
_NODES, _EDGES_PER_NODE = 1000, 20
_CLIQUES_LOOKED_AT, _CLIQUES_TRIED = 30_000, 1000


def require_networkx() -> Any:
    """Imports the library that finds the cliques.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import networkx as nx  # noqa: PLC0415 - optional
    except ImportError as error:
        raise MissingExtraError("networkx", "bench", "the peer fpfh_mac") from error
    return nx


def mac(matches: Correspondences) -> Float64 | None:
    """The transform of the clique that agrees best with all matches.

    Args:
        matches: geometric matches, most of them wrong.

    Returns:
        T_target_source, or None if there is no clique of three.

    Raises:
        MissingExtraError: networkx is not installed.
    """
    nx = require_networkx()
    candidates = matches.select(np.argsort(-matches.weights, kind="stable")[: 3 * _NODES])
    if len(candidates) < 3:
        return None
    weights = _second_order(candidates)
    nodes = np.sort(np.argsort(-weights.sum(axis=1), kind="stable")[:_NODES])
    candidates, weights = candidates.select(nodes), weights[np.ix_(nodes, nodes)]
    graph = nx.from_numpy_array(_thinned(weights))
    best, most = None, 0.0
    for clique in _selected(nx.find_cliques(graph), weights):
        members = np.array(clique)
        T = procrustes(
            candidates.source[members],
            candidates.target[members],
            weights[np.ix_(members, members)].sum(axis=1).astype(np.float64),
        )
        # mean absolute error of the inliers, the score of hypotheses in the publication
        score = float(np.maximum(1 - distances(T, candidates) / _INLIER_M, 0).sum())
        if score > most:
            best, most = T, score
    return best


def _second_order(matches: Correspondences) -> Float32:
    """Edge weights: first-order compatibility times how much of it two matches share."""
    first = np.maximum(1 - (length_differences(matches) / np.float32(_COMPATIBILITY_M)) ** 2, 0)
    first[first < _LEAST_COMPATIBILITY] = 0
    np.fill_diagonal(first, 0)
    weights: Float32 = first * (first @ first)
    return weights


def _thinned(weights: Float32) -> Float32:
    """The heaviest edges, up to the limit for a graph of these nodes."""
    edges = np.triu(weights)
    heaviest = _EDGES_PER_NODE * len(weights)
    if np.count_nonzero(edges) > heaviest:
        least = np.partition(edges.ravel(), -heaviest)[-heaviest]
        edges[edges < least] = 0
    return edges


def _selected(cliques: Iterable[list[int]], weights: Float32) -> list[list[int]]:
    """Node-guided selection: the heaviest clique of every node, the heaviest of these first."""
    heaviest: dict[int, tuple[float, list[int]]] = {}
    for clique in islice(cliques, _CLIQUES_LOOKED_AT):
        if len(clique) < 3:
            continue
        weight = float(weights[np.ix_(clique, clique)].sum())
        for node in clique:
            if node not in heaviest or weight > heaviest[node][0]:
                heaviest[node] = weight, clique
    unique: dict[Any, float] = {tuple(sorted(c)): weight for weight, c in heaviest.values()}
    ranked = sorted(unique, key=lambda clique: (-unique[clique], clique))
    return [list(clique) for clique in ranked[:_CLIQUES_TRIED]]
