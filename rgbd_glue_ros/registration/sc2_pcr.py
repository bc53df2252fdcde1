"""SC2-PCR: second order spatial compatibility (Chen, Sun, Yang and Tao, CVPR 2022).

Two matches are compatible if a rigid motion could have moved both; two inliers have many third
matches that are compatible with both, which outliers rarely have.
"""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.geometry.fitting import distances, procrustes
from rgbd_glue_ros.registration.compatibility import length_differences, refined
from rgbd_glue_ros.types import Correspondences, Float32, Float64, Int64

INLIER_M = 0.1
"""Maximum error of an inlier, metres: the publication's indoors."""
# All that follow are the publication's, too.
# The fraction of the matches that become seeds, at most.
_SEEDS = 0.2
# Matches most compatible with a seed, and those of them most compatible among themselves.
_FIRST_SET, _SECOND_SET = 30, 20
# Multiplications after which a vector is the leading eigenvector.
_POWER_ITERATIONS = 10


def sc2_pcr(
    matches: Correspondences, threshold: float = INLIER_M, most: int = 3000
) -> tuple[Float64 | None, int]:
    """The transform that most matches agree with, out of one for each seed.

    Args:
        matches: geometric matches, most of them wrong.
        threshold: maximum difference of lengths between compatible matches, and maximum error of
            an inlier, metres.
        most: maximum number of matches considered, those with the largest weights.

    Returns:
        T_target_source, None if there are fewer than three matches; and the number of considered
        matches that agree with it.
    """
    if len(matches) > most:
        matches = matches.select(np.argsort(-matches.weights, kind="stable")[:most])
    if len(matches) < 3:
        return None, 0
    difference = length_differences(matches)
    soft = np.maximum(1 - (difference / np.float32(threshold)) ** 2, 0)
    hard = (difference <= threshold).astype(np.float32)
    seeds = _seeds(_leading_eigenvector(soft), matches.source, threshold)
    second_order = hard[seeds] * (hard[seeds] @ hard)
    best, most_inliers = None, 0
    for row, seed in enumerate(seeds):
        members = _consensus(seed, second_order[row], hard)
        if len(members) < 3:
            continue
        weights = _leading_eigenvector(soft[np.ix_(members, members)]).astype(np.float64)
        if np.count_nonzero(weights) < 3:
            continue
        T = procrustes(matches.source[members], matches.target[members], weights)
        inliers = int((distances(T, matches) < threshold).sum())
        if inliers > most_inliers:
            best, most_inliers = T, inliers
    if best is None:
        return None, 0
    best = refined(best, matches, threshold)
    return best, int((distances(best, matches) < threshold).sum())


def _leading_eigenvector(matrix: Float32) -> Float32:
    """That of a non-negative matrix; its elements say how well each match fits in."""
    vector = np.ones(len(matrix), np.float32)
    for _ in range(_POWER_ITERATIONS):
        vector = matrix @ vector
        vector /= np.linalg.norm(vector)
    return vector


def _seeds(confidence: Float32, points: Float64, radius: float) -> Int64:
    """The most confident matches, each the best one within ``radius``."""
    order = np.argsort(-confidence, kind="stable")
    count = max(1, round(_SEEDS * len(order)))
    seeds: list[int] = []
    free = np.ones(len(order), bool)
    for match in order:
        if free[match]:
            seeds.append(int(match))
            if len(seeds) == count:
                break
            free &= np.linalg.norm(points - points[match], axis=1) > radius
    return np.array(seeds, np.int64)


def _consensus(seed: int, second_order: Float32, hard: Float32) -> Int64:
    """The matches most compatible with a seed, chosen from all, then again among the chosen."""
    first = np.argsort(-second_order, kind="stable")[:_FIRST_SET]
    first = first[second_order[first] > 0]
    if seed not in first:
        first = np.append(first, seed)
    local = hard[np.ix_(first, first)]
    place = int(np.flatnonzero(first == seed)[0])
    within = local[place] * (local @ local[place])
    second = np.argsort(-within, kind="stable")[:_SECOND_SET]
    return np.asarray(first[second[within[second] > 0]], np.int64)
