"""The paper's geometric features: a cloud thinned to voxels, with normals and FPFH.

Neighbourhoods, normals and histograms are those of Open3D, computed three to four times as fast.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.features.fpfh import BINS, pair_bins
from rgbd_glue_ros.types import Float32, Float64, Int64, Mask


def voxel_means(points: Float64, edge: float) -> Float64:
    """The mean of the points in each cube of a grid, [M, 3], ordered by cube.

    Args:
        points: float64 [N, 3], metres.
        edge: edge of a cube, metres.
    """
    if not len(points):
        return np.empty((0, 3))
    # the grid starts half an edge before the first point, as in Open3D
    cubes = np.floor((points - points.min(axis=0)) / edge + 0.5).astype(np.int64)
    rows, columns, _ = cubes.max(axis=0) + 1
    key = cubes[:, 0] + rows * (cubes[:, 1] + columns * cubes[:, 2])
    return group_means(points, np.unique(key, return_inverse=True)[1])


def group_means(rows: Float64, group: Int64) -> Float64:
    """The mean of the rows [N, K] of each group, [G, K].

    Args:
        rows: float64 [N, K].
        group: int64 [N], the group of each row; none is empty.
    """
    sums = [np.bincount(group, weights=column) for column in rows.T]
    return np.stack(sums, axis=1) / np.bincount(group)[:, None]


def neighbourhoods(points: Float64, radius: float, most: int) -> tuple[Int64, Float64]:
    """The nearest ``most`` points within ``radius`` of each point, itself first.

    Returns:
        Indices int64 [N, most], N where there is no further neighbour; distances float64
        [N, most], infinite there.
    """
    distances, numbers = cKDTree(points).query(points, most, distance_upper_bound=radius)
    return numbers.reshape(-1, most), distances.reshape(-1, most)


def normals(
    points: Float64, neighbours: Int64, distances: Float64, radius: float, most: int
) -> Float64:
    """Unit normals towards the camera, float64 [N, 3]; along the ray for an isolated point.

    Args:
        points: float64 [N, 3] in the optical frame.
        neighbours: of each point, as ``neighbourhoods`` gives them.
        distances: to those.
        radius: of the neighbourhood that the plane is fitted to.
        most: maximum number of neighbours that it is fitted to.
    """
    covariances, alone = _covariances(points, neighbours[:, :most], distances[:, :most], radius)
    directions = np.linalg.eigh(covariances)[1][:, :, 0]
    directions[alone] = -points[alone] / np.linalg.norm(points[alone], axis=1)[:, None]
    away = np.einsum("ij,ij->i", directions, points) > 0
    directions[away] *= -1
    return np.ascontiguousarray(directions)


@compiled
def _covariances(
    points: Float64, neighbours: Int64, distances: Float64, radius: float
) -> tuple[Float64, Mask]:
    n = len(points)
    covariances = np.zeros((n, 3, 3))
    alone = np.zeros(n, np.bool_)
    for i in range(n):
        count = 0
        mean = np.zeros(3)
        for k in range(neighbours.shape[1]):
            if distances[i, k] >= radius:
                break
            mean += points[neighbours[i, k]]
            count += 1
        mean /= count
        for k in range(count):
            d = points[neighbours[i, k]] - mean
            for a in range(3):
                for b in range(3):
                    covariances[i, a, b] += d[a] * d[b]
        alone[i] = count < 3
    return covariances, alone


@compiled
def fpfh(points: Float64, normals: Float64, neighbours: Int64, distances: Float64) -> Float32:
    """FPFH of every point over its neighbours, float32 [N, 33]; zero if it is isolated.

    Args:
        points: float64 [N, 3].
        normals: unit normals, same shape.
        neighbours: of each point, itself first, as ``neighbourhoods`` gives them.
        distances: to those, metres.
    """
    n = len(points)
    spfh = np.zeros((n, 3 * BINS), np.float32)
    for i in range(n):
        count = 0
        for k in range(1, neighbours.shape[1]):
            if not distances[i, k] < np.inf:
                break
            count += 1
        for k in range(1, count + 1):
            j = neighbours[i, k]
            squared = distances[i, k] ** 2
            if squared == 0.0:
                continue
            d = points[j] - points[i]
            normal = (normals[i, 0], normals[i, 1], normals[i, 2])
            other = (normals[j, 0], normals[j, 1], normals[j, 2])
            b0, b1, b2 = pair_bins((d[0], d[1], d[2]), squared, normal, other)
            share = np.float32(100.0 / count)
            spfh[i, b0] += share
            spfh[i, BINS + b1] += share
            spfh[i, 2 * BINS + b2] += share
    histograms = np.zeros((n, 3 * BINS), np.float32)
    for i in range(n):
        weights = np.float32(0.0)
        for k in range(1, neighbours.shape[1]):
            if not distances[i, k] < np.inf:
                break
            if distances[i, k] == 0.0:
                continue
            w = np.float32(1.0 / distances[i, k] ** 2)
            weights += w
            j = neighbours[i, k]
            for b in range(3 * BINS):
                histograms[i, b] += w * spfh[j, b]
        if weights > 0.0:
            # each neighbour's three histograms sum to 100 each, so the weights are the sum
            for b in range(3 * BINS):
                histograms[i, b] = spfh[i, b] + histograms[i, b] / weights
    return histograms
