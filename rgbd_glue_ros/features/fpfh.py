"""Fast Point Feature Histograms (Rusu, Blodow and Beetz 2009) on an organised grid of points.

The depth image gives every point its neighbours, so no tree is built: a pixel window holds them.
On the same neighbourhoods the histograms equal Open3D's.
"""

from __future__ import annotations

import math

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.types import Float32, Float64

BINS = 11

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
    for r in range(rows):
        for c in range(columns):
            if not points[r, c, 2] > 0.0:
                continue
            # the features of a pair are the same from both ends: half of the window serves both
            for i in range(r, min(rows, r + half_window + 1)):
                first = c + 1 if i == r else max(0, c - half_window)
                for j in range(first, min(columns, c + half_window + 1)):
                    dx = points[i, j, 0] - points[r, c, 0]
                    dy = points[i, j, 1] - points[r, c, 1]
                    dz = points[i, j, 2] - points[r, c, 2]
                    squared = dx * dx + dy * dy + dz * dz
                    if not 0.0 < squared <= limit:
                        continue
                    b0, b1, b2 = pair_bins(dx, dy, dz, squared, normals[r, c], normals[i, j])
                    for y, x in ((r, c), (i, j)):
                        spfh[y, x, b0] += 1.0
                        spfh[y, x, BINS + b1] += 1.0
                        spfh[y, x, 2 * BINS + b2] += 1.0
                        neighbours[y, x] += 1
    for r in range(rows):
        for c in range(columns):
            if neighbours[r, c] > 0:
                spfh[r, c] *= np.float32(100.0 / neighbours[r, c])
    return _weighted_sum(points, spfh, limit, half_window)


@compiled
def pair_bins(
    dx: float, dy: float, dz: float, squared: float, n1: Float64, n2: Float64
) -> tuple[int, int, int]:
    """The bins of the angles theta, alpha and phi of a pair of oriented points."""
    d = math.sqrt(squared)
    phi1 = (n1[0] * dx + n1[1] * dy + n1[2] * dz) / d
    phi2 = (n2[0] * dx + n2[1] * dy + n2[2] * dz) / d
    # the source of the pair is the point whose normal is nearer to the line between them
    if abs(phi1) < abs(phi2):
        n1, n2 = n2, n1
        dx, dy, dz = -dx, -dy, -dz
        phi = -phi2
    else:
        phi = phi1
    # Darboux frame: u = n1, v = d x u, w = u x v
    vx = dy * n1[2] - dz * n1[1]
    vy = dz * n1[0] - dx * n1[2]
    vz = dx * n1[1] - dy * n1[0]
    length = math.sqrt(vx * vx + vy * vy + vz * vz)
    b0, alpha = BINS // 2, 0.0
    if length > 0.0:
        vx, vy, vz = vx / length, vy / length, vz / length
        wx = n1[1] * vz - n1[2] * vy
        wy = n1[2] * vx - n1[0] * vz
        wz = n1[0] * vy - n1[1] * vx
        alpha = vx * n2[0] + vy * n2[1] + vz * n2[2]
        b0 = _angle_bin(
            wx * n2[0] + wy * n2[1] + wz * n2[2], n1[0] * n2[0] + n1[1] * n2[1] + n1[2] * n2[2]
        )
    else:
        phi = 0.0
    return b0, _bin((alpha + 1.0) * 0.5), _bin((phi + 1.0) * 0.5)


@compiled
def _bin(fraction: float) -> int:
    return min(max(math.floor(BINS * fraction), 0), BINS - 1)


@compiled
def _angle_bin(y: float, x: float) -> int:
    """The bin of atan2(y, x) among those of [-pi, pi], from which edges it is to the left of."""
    angle_bin = 0 if y < 0.0 else BINS // 2
    for k in range(angle_bin + 1, angle_bin + 1 + BINS // 2):
        if _COSINES[k] * y - _SINES[k] * x > 0.0:
            angle_bin += 1
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
                        fpfh[r, c, k] += w * spfh[i, j, k]
                    for k in range(3 * BINS):
                        fpfh[i, j, k] += w * spfh[r, c, k]
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
