"""Fast Point Feature Histograms (Rusu, Blodow and Beetz 2009) on an organised grid of points.

The depth image gives every point its neighbours, so no tree is built: a pixel window holds them.
On the same neighbourhoods the histograms equal Open3D's.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.compiled import compiled, inlined
from rgbd_glue_ros.types import Float32, Float64

BINS = 11
_NO_NEIGHBOUR = -1

Vector = tuple[float, float, float]

# Lower edges of the bins of an angle in [-pi, pi].
_EDGES = -np.pi + 2 * np.pi / BINS * np.arange(BINS)
_COSINES, _SINES = np.cos(_EDGES), np.sin(_EDGES)


@compiled
def grid_fpfh(points: Float64, normals: Float64, radius: float, half_window: int) -> Float32:
    """FPFH of every grid point over the neighbours within ``radius`` in its window.

    Args:
        points: float64 [rows, columns, 3], NaN where unknown.
        normals: unit normals, same shape.
        radius: of the neighbourhood, metres.
        half_window: cells to each side that are searched for neighbours.

    Returns:
        float32 [rows, columns, 33]; zero where the point is unknown or alone.
    """
    rows, columns = points.shape[:2]
    spfh = np.zeros((rows, columns, 3 * BINS), np.float32)
    neighbours = np.zeros((rows, columns), np.int32)
    limit = radius * radius
    # coordinates of a row side by side: the compiler then computes several pairs at once
    P = np.ascontiguousarray(points.transpose(0, 2, 1))
    N = np.ascontiguousarray(normals.transpose(0, 2, 1))
    bins = np.empty((3, columns), np.int32)
    for r in range(rows):
        # the features of a pair are the same from both ends: half of the window serves both
        for i in range(r, min(rows, r + half_window + 1)):
            for shift in range(1 if i == r else -half_window, half_window + 1):
                _row_bins(P[r], N[r], P[i], N[i], shift, limit, bins)
                for c in range(max(0, -shift), min(columns, columns - shift)):
                    if bins[0, c] == _NO_NEIGHBOUR:
                        continue
                    for y, x in ((r, c), (i, c + shift)):
                        for k in range(3):
                            spfh[y, x, k * BINS + bins[k, c]] += 1.0
                        neighbours[y, x] += 1
    for r in range(rows):
        for c in range(columns):
            if neighbours[r, c] > 0:
                spfh[r, c] *= np.float32(100.0 / neighbours[r, c])
    return _weighted_sum(points, spfh, limit, half_window)


@compiled
def _row_bins(
    points: Float64,
    normals: Float64,
    others: Float64,
    their_normals: Float64,
    shift: int,
    limit: float,
    bins: NDArray[np.int32],
) -> None:
    """The bins of pairs of points of two rows of a grid.

    Args:
        points: float64 [3, C], a row.
        normals: float64 [3, C], of its points.
        others: float64 [3, C], the same or another row.
        their_normals: float64 [3, C].
        shift: how many columns farther to the right the other point of a pair is.
        limit: largest squared distance of neighbours, m².
        bins: int32 [3, C], set to those of each pair, by its first point; the first of the three is
            ``_NO_NEIGHBOUR`` if the points are too far apart.
    """
    columns = points.shape[1]
    first, last = max(0, -shift), min(columns, columns - shift)
    X, Y, Z = points[0, first:last], points[1, first:last], points[2, first:last]
    NX, NY, NZ = normals[0, first:last], normals[1, first:last], normals[2, first:last]
    theta, alpha, phi = bins[0, first:last], bins[1, first:last], bins[2, first:last]
    first, last = first + shift, last + shift
    X2, Y2, Z2 = others[0, first:last], others[1, first:last], others[2, first:last]
    NX2, NY2 = their_normals[0, first:last], their_normals[1, first:last]
    NZ2 = their_normals[2, first:last]
    for k in range(len(X)):
        dx, dy, dz = X2[k] - X[k], Y2[k] - Y[k], Z2[k] - Z[k]
        squared = dx * dx + dy * dy + dz * dz
        normal, other_normal = (NX[k], NY[k], NZ[k]), (NX2[k], NY2[k], NZ2[k])
        bin_of_theta, bin_of_alpha, bin_of_phi = pair_bins(
            (dx, dy, dz), squared, normal, other_normal
        )
        is_near = (squared > 0.0) & (squared <= limit)
        theta[k] = bin_of_theta if is_near else _NO_NEIGHBOUR
        alpha[k], phi[k] = bin_of_alpha, bin_of_phi


@inlined
def pair_bins(d: Vector, squared: float, normal: Vector, other: Vector) -> tuple[int, int, int]:
    """The bins of the angles theta, alpha and phi of a pair of oriented points.

    Without branches, so that loops over it can be vectorised.

    Args:
        d: from the first point to the second.
        squared: its squared length.
        normal: at the first point.
        other: at the second.
    """
    length = math.sqrt(squared)
    phi1 = (normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2]) / length
    phi2 = (other[0] * d[0] + other[1] * d[1] + other[2] * d[2]) / length
    # the source of the pair is the point whose normal is nearer to the line between them
    is_other = abs(phi1) < abs(phi2)
    ux, nx = (other[0], normal[0]) if is_other else (normal[0], other[0])
    uy, ny = (other[1], normal[1]) if is_other else (normal[1], other[1])
    uz, nz = (other[2], normal[2]) if is_other else (normal[2], other[2])
    sign = -1.0 if is_other else 1.0
    dx, dy, dz = sign * d[0], sign * d[1], sign * d[2]
    phi = -phi2 if is_other else phi1
    # Darboux frame: u, v = d x u, w = u x v
    vx, vy, vz = dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux
    across = math.sqrt(vx * vx + vy * vy + vz * vz)
    has_frame = across > 0.0
    divisor = across if has_frame else 1.0
    vx, vy, vz = vx / divisor, vy / divisor, vz / divisor
    wx, wy, wz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    alpha = vx * nx + vy * ny + vz * nz
    theta = _angle_bin(wx * nx + wy * ny + wz * nz, ux * nx + uy * ny + uz * nz)
    return (
        theta if has_frame else BINS // 2,
        _bin((alpha + 1.0) * 0.5) if has_frame else BINS // 2,
        _bin((phi + 1.0) * 0.5) if has_frame else BINS // 2,
    )


@inlined
def _bin(fraction: float) -> int:
    return int(min(max(math.floor(BINS * fraction), 0.0), BINS - 1.0))


@inlined
def _angle_bin(y: float, x: float) -> int:
    """The bin of atan2(y, x) among those of [-pi, pi], from which edges it is to the left of."""
    is_below = y < 0.0
    angle_bin = 0 if is_below else BINS // 2
    for k in range(1, 1 + BINS // 2):
        cosine = _COSINES[k] if is_below else _COSINES[k + BINS // 2]
        sine = _SINES[k] if is_below else _SINES[k + BINS // 2]
        angle_bin += int(cosine * y - sine * x > 0.0)
    return angle_bin


@compiled
def _weighted_sum(points: Float64, spfh: Float32, limit: float, half_window: int) -> Float32:
    """FPFH(p) = SPFH(p) + the neighbours' SPFH by inverse squared distance, scaled to 100."""
    rows, columns = points.shape[:2]
    fpfh = np.zeros((rows, columns, 3 * BINS), np.float32)
    weight = np.zeros((rows, columns), np.float32)
    for r in range(rows):
        for c in range(columns):
            if not points[r, c, 2] > 0.0:
                continue
            for i in range(r, min(rows, r + half_window + 1)):
                first = c + 1 if i == r else max(0, c - half_window)
                for j in range(first, min(columns, c + half_window + 1)):
                    dx = points[i, j, 0] - points[r, c, 0]
                    dy = points[i, j, 1] - points[r, c, 1]
                    dz = points[i, j, 2] - points[r, c, 2]
                    squared = dx * dx + dy * dy + dz * dz
                    if not 0.0 < squared <= limit:
                        continue
                    w = np.float32(1.0 / squared)
                    weight[r, c] += w
                    weight[i, j] += w
                    for k in range(3 * BINS):
                        own, others = spfh[r, c, k], spfh[i, j, k]
                        fpfh[r, c, k] += w * others
                        fpfh[i, j, k] += w * own
    for r in range(rows):
        for c in range(columns):
            if weight[r, c] > 0.0:
                # each neighbour's three histograms sum to 100, so the weights are the sum
                for k in range(3 * BINS):
                    fpfh[r, c, k] = spfh[r, c, k] + fpfh[r, c, k] / weight[r, c]
    return fpfh


@compiled
def guided_search(
    source: Float64,
    source_descriptors: Float32,
    target: Float64,
    target_descriptors: Float32,
    T: Float64,
    camera: Float64,
    step: int,
    radius: float,
    half_window: int,
) -> tuple[Float64, Float64, Float64]:
    """For each source point, the target point within ``radius`` of T p with the nearest feature.

    What equation 8 would keep, searched for directly: only the grid cells around the pixel that
    T p projects to are compared.

    Args:
        source: float64 [rows, columns, 3], NaN where unknown.
        source_descriptors: float32 [rows, columns, D].
        target: float64 [rows, columns, 3], NaN where unknown.
        target_descriptors: float32 [rows, columns, D].
        T: T_target_source, float64 [4, 4].
        camera: fx, fy, cx, cy.
        step: pixels between grid points.
        radius: epsilon, metres.
        half_window: cells to each side that are searched, at most.

    Returns:
        Points p and q, float64 [N, 3], and the distances of their features, float64 [N].
    """
    rows, columns = target.shape[:2]
    capacity = source.shape[0] * source.shape[1]
    p, q, distance = np.empty((capacity, 3)), np.empty((capacity, 3)), np.empty(capacity)
    n = 0
    fx, fy, cx, cy = camera
    offset = step // 2
    for r in range(source.shape[0]):
        for c in range(source.shape[1]):
            if not source[r, c, 2] > 0.0:
                continue
            x = T[0, 0] * source[r, c, 0] + T[0, 1] * source[r, c, 1] + T[0, 2] * source[r, c, 2]
            y = T[1, 0] * source[r, c, 0] + T[1, 1] * source[r, c, 1] + T[1, 2] * source[r, c, 2]
            z = T[2, 0] * source[r, c, 0] + T[2, 1] * source[r, c, 1] + T[2, 2] * source[r, c, 2]
            x, y, z = x + T[0, 3], y + T[1, 3], z + T[2, 3]
            if z <= 0.05:
                continue
            column = round((fx * x / z + cx - offset) / step)
            row = round((fy * y / z + cy - offset) / step)
            reach = min(half_window, math.ceil(radius * fx / (z * step)))
            best, best_row, best_column = np.inf, -1, -1
            for i in range(max(0, row - reach), min(rows, row + reach + 1)):
                for j in range(max(0, column - reach), min(columns, column + reach + 1)):
                    dx, dy, dz = target[i, j, 0] - x, target[i, j, 1] - y, target[i, j, 2] - z
                    if not dx * dx + dy * dy + dz * dz <= radius * radius:
                        continue
                    squared = np.float32(0.0)
                    for k in range(source_descriptors.shape[2]):
                        difference = source_descriptors[r, c, k] - target_descriptors[i, j, k]
                        squared += difference * difference
                    if squared < best:
                        best, best_row, best_column = squared, i, j
            if best_row >= 0:
                p[n] = source[r, c]
                q[n] = target[best_row, best_column]
                distance[n] = math.sqrt(best)
                n += 1
    return p[:n], q[:n], distance[:n]
