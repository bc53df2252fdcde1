"""Rigid transforms from matched points: weighted Procrustes, its randomised form, RANSAC."""

from __future__ import annotations

import math

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry.se3 import skew, transform
from rgbd_glue_ros.types import Correspondences, Float64, Int64

# A sample or set whose points spread less than this across a line leaves the rotation about it
# free.
_MIN_SPREAD_M = 1e-3


@compiled
def procrustes(source: Float64, target: Float64, weights: Float64) -> Float64:
    """Equation 10: the T that minimises sum_i w_i |T p_i - q_i|² (Kabsch 1976).

    Args:
        source: p, float64 [N, 3].
        target: q, float64 [N, 3].
        weights: w, float64 [N], not negative, some positive.

    Returns:
        T_target_source, float64 [4, 4]; a proper rotation even for mirrored points.
    """
    total = weights.sum()
    mean_p, mean_q = np.zeros(3), np.zeros(3)
    for i in range(len(weights)):
        for a in range(3):
            mean_p[a] += weights[i] / total * source[i, a]
            mean_q[a] += weights[i] / total * target[i, a]
    H = np.zeros((3, 3))
    for i in range(len(weights)):
        for a in range(3):
            w = weights[i] * (target[i, a] - mean_q[a])
            for b in range(3):
                H[a, b] += w * (source[i, b] - mean_p[b])
    U, _, Vt = np.linalg.svd(H)
    sign = np.eye(3)
    sign[2, 2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    R = U @ sign @ Vt
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = mean_q - R @ mean_p
    return T


def randomised_procrustes(
    matches: Correspondences, subsets: int, fraction: float, rng: np.random.Generator
) -> Float64:
    """The randomised optimisation of section 3.3 (El Banani, Gao and Johnson, CVPR 2021).

    Fits weighted Procrustes to random subsets and keeps the transform with the least weighted
    residual over all matches; if no subset has three matches with weight, the fit to all.

    Args:
        matches: the set C, at least 3, some with positive weight.
        subsets: number of random subsets; 0 fits all matches at once.
        fraction: fraction of the matches in each subset.
        rng: source of the random choices.

    Returns:
        T_target_source, float64 [4, 4].
    """
    size = min(len(matches), max(3, round(fraction * len(matches))))
    rows = [rng.permutation(len(matches))[:size] for _ in range(subsets)]
    return _best_subset(
        matches.source,
        matches.target,
        matches.weights,
        np.asarray(rows, np.int64).reshape(subsets, size),
    )


@compiled
def _best_subset(source: Float64, target: Float64, weights: Float64, subsets: Int64) -> Float64:
    """The fit with the least weighted residual, of those to each row of int64 [subsets, size]."""
    best = procrustes(source, target, weights)
    least = np.inf
    for rows in subsets:
        w = weights[rows]
        if np.count_nonzero(w) < 3:
            continue
        T = procrustes(source[rows], target[rows], w)
        # squares would favour the subset whose fit is nearest to that of all, including outliers
        residual = 0.0
        for i in range(len(weights)):
            residual += weights[i] * _distance(T, source, target, i)
        if residual < least:
            best, least = T, residual
    return best


def distances(T: Float64, matches: Correspondences) -> Float64:
    """Equation 2: d_T = |T p - q| of each match, float64 [N], metres."""
    return _distances(T, matches.source, matches.target)


@compiled
def _distances(T: Float64, source: Float64, target: Float64) -> Float64:
    d_T = np.empty(len(source))
    for i in range(len(source)):
        d_T[i] = _distance(T, source, target, i)
    return d_T


@compiled
def _distance(T: Float64, source: Float64, target: Float64, i: int) -> float:
    squared = 0.0
    for a in range(3):
        d = T[a, 3] - target[i, a]
        for b in range(3):
            d += T[a, b] * source[i, b]
        squared += d * d
    return math.sqrt(squared)


def ransac(
    matches: Correspondences, threshold: float, iterations: int, rng: np.random.Generator
) -> tuple[Float64 | None, int]:
    """The rough transform T of section 3.2 (Fischler and Bolles 1981).

    Draws samples of three matches until a better transform than the best is unlikely (99.9 %),
    then fits all its inliers.

    Args:
        matches: C_vis.
        threshold: t_in, metres.
        iterations: maximum number of samples.
        rng: source of the samples.

    Returns:
        T_target_source, or None if no three matches agree; and the number of its inliers.
    """
    if len(matches) < 3:
        return None, 0
    samples = _samples(len(matches), iterations, rng)
    best, count = _best_sample(matches.source, matches.target, samples, threshold)
    if count < 3:
        return None, 0
    ones = np.ones(len(matches))
    T = procrustes(*(a[samples[best]] for a in (matches.source, matches.target, ones)))
    for _ in range(3):
        inliers = distances(T, matches) <= threshold
        refined = procrustes(*(a[inliers] for a in (matches.source, matches.target, ones)))
        grown = int((distances(refined, matches) <= threshold).sum())
        if grown < count:
            break
        T, count = refined, grown
    return T, count


def _samples(n: int, iterations: int, rng: np.random.Generator) -> Int64:
    """``iterations`` triples of distinct numbers below n, int64 [iterations, 3]."""
    a = rng.integers(0, n, iterations)
    b = rng.integers(0, n - 1, iterations)
    c = rng.integers(0, n - 2, iterations)
    # shift past the numbers already drawn, so that every triple is equally likely
    b += b >= a
    low, high = np.minimum(a, b), np.maximum(a, b)
    c += c >= low
    c += c >= high
    return np.stack([a, b, c], axis=1)


@compiled
def _best_sample(
    source: Float64, target: Float64, samples: Int64, threshold: float
) -> tuple[int, int]:
    """The sample with most inliers, and their number; stops once a better one is unlikely."""
    n = len(source)
    best, most = 0, 0
    needed = len(samples)
    ones = np.ones(3)
    for s in range(len(samples)):
        if s >= needed:
            break
        rows = samples[s]
        # a rigid motion preserves lengths: most wrong samples end here, before any fit
        rigid = True
        for a in range(3):
            i, j = rows[a], rows[(a + 1) % 3]
            length_p = np.sqrt(((source[i] - source[j]) ** 2).sum())
            length_q = np.sqrt(((target[i] - target[j]) ** 2).sum())
            if abs(length_p - length_q) > 2 * threshold or length_p < _MIN_SPREAD_M:
                rigid = False
        if not rigid:
            continue
        T = procrustes(source[rows], target[rows], ones)
        count = 0
        for i in range(n):
            if _distance(T, source, target, i) <= threshold:
                count += 1
        if count > most:
            best, most = s, count
            all_inliers = min((count / n) ** 3, 1 - 1e-12)
            needed = min(needed, int(np.log(1e-3) / np.log1p(-all_inliers)) + 1)
    return best, most


def procrustes_information(T: Float64, matches: Correspondences) -> Float64:
    """The Gauss-Newton Hessian [6, 6] of equation 10 at T (sum of w_i J_i^T J_i).

    Order x y z rx ry rz, perturbation on the left of T, in the target frame.
    """
    moved = transform(T, matches.source)
    w = matches.weights
    H = np.zeros((6, 6))
    H[:3, :3] = np.eye(3) * w.sum()
    # J = [I, -skew(m)] for m = T p
    H[:3, 3:] = -skew(w @ moved)
    H[3:, :3] = H[:3, 3:].T
    outer = (moved.T * w) @ moved
    H[3:, 3:] = np.eye(3) * np.trace(outer) - outer
    return H


def fit_covariance(T: Float64, matches: Correspondences) -> Float64 | None:
    """Covariance [6, 6] of the weighted Procrustes fit, from its own residuals.

    That of weighted least squares with independent errors of equal variance s²,
    H⁻¹ (sum w² JᵀJ s²) H⁻¹ with H = sum w JᵀJ; s² by moments as in equation 5.

    Returns:
        Order x y z rx ry rz, perturbation on the left, target frame; None if the matches leave a
        degree of freedom undetermined.
    """
    H = procrustes_information(T, matches)
    scale = np.sqrt(np.diag(H))
    if (scale <= 0).any() or np.linalg.cond(H / np.outer(scale, scale)) > 1e8:
        return None
    w = matches.weights
    variance = float(w @ distances(T, matches) ** 2 / w.sum()) / 3
    squared = Correspondences(matches.source, matches.target, w**2)
    inverse = np.linalg.inv(H)
    covariance: Float64 = inverse @ (procrustes_information(T, squared) * variance) @ inverse
    symmetric: Float64 = (covariance + covariance.T) / 2
    return symmetric
