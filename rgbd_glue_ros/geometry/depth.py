"""Depth: its noise, its range, its value between pixels, and when depths are of one surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.parameters import CameraConfig
from rgbd_glue_ros.types import Float32, Float64

# The result of an overflow of 16 bits: as a depth it would be a wall that does not exist.
OVERFLOW = np.iinfo(np.uint16).max
# Depth noise of structured light, metres: least at a distance, and growing with its square.
_LEAST_SIGMA_M, _SIGMA_GROWTH, _LEAST_AT_M = 0.0012, 0.0019, 0.4
# A bilinear depth across a step larger than this many sigma would lie on neither surface.
DEPTH_EDGE_SIGMAS = 6.0
# Two depths farther apart than this many sigma are not the same surface.
SURFACE_SIGMAS = 10.0
# A surface may recede by this fraction of its depth within the neighbourhood considered.
RECEDING = 0.02


@compiled
def depth_sigma(z: float) -> float:
    """Standard deviation of a structured-light depth z, metres (Khoshelham and Elberink 2012).

    The form 0.0012 + 0.0019 (z - 0.4)^2 is that of Nguyen, Izadi and Lovell (3DIMPVT 2012).
    """
    return _LEAST_SIGMA_M + _SIGMA_GROWTH * (z - _LEAST_AT_M) ** 2


def depth_sigmas(depth: Float32) -> Float32:
    """``depth_sigma`` of every pixel of a depth image [H, W]; NaN where it is unknown."""
    beyond = depth.astype(np.float64) - _LEAST_AT_M
    return (_LEAST_SIGMA_M + _SIGMA_GROWTH * beyond**2).astype(np.float32)


def metres_of_16_bits(depth: NDArray[np.uint16], units_per_metre: float) -> Float32:
    """Depth [H, W] in metres; NaN where it is 0, has overflowed or is not finite."""
    # arrays of one kind, whatever message they come from, need only one compilation
    pixels = np.require(depth, np.uint16, ["C", "ALIGNED"]).view()
    pixels.flags.writeable = False
    return np.asarray(_metres(pixels, np.float32(units_per_metre)), np.float32)


@compiled
def _metres(depth: NDArray[np.uint16], units_per_metre: np.float32) -> Float32:
    metres = np.empty(depth.shape, np.float32)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = np.float32(depth[v, u]) / units_per_metre
            # all comparisons are evaluated, so that there is no branch
            is_known = (depth[v, u] != OVERFLOW) & (z > 0) & (z < np.float32(np.inf))
            metres[v, u] = z if is_known else np.float32(np.nan)
    return metres


def limit_depth(depth: Float32, limits: CameraConfig) -> Float32:
    """A copy of ``depth`` with values outside [depth_min, depth_max] unknown (NaN)."""
    return np.asarray(_limited(depth, limits.depth_min, limits.depth_max), np.float32)


@compiled
def _limited(depth: Float32, nearest: float, farthest: float) -> Float32:
    limited = np.empty(depth.shape, np.float32)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            # both comparisons are evaluated, so that there is no branch
            limited[v, u] = z if (z >= nearest) & (z <= farthest) else np.float32(np.nan)
    return limited


@compiled
def sample_depth(depth: Float32, u: float, v: float, noise: float = 1.0) -> float:
    """Bilinear depth at pixel (u, v); NaN outside, next to unknown depth and across edges.

    ``noise`` is that of depth, relative to ``depth_sigma``.
    """
    height, width = depth.shape
    if not (u >= 0.0 and v >= 0.0 and u <= width - 1.0 and v <= height - 1.0):
        return np.nan
    u0, v0 = min(int(u), width - 2), min(int(v), height - 2)
    a, b = u - u0, v - v0
    z00, z01 = depth[v0, u0], depth[v0, u0 + 1]
    z10, z11 = depth[v0 + 1, u0], depth[v0 + 1, u0 + 1]
    nearest = min(z00, z01, z10, z11)
    farthest = max(z00, z01, z10, z11)
    # false too if the first is unknown; another unknown one makes the sum below NaN
    if not farthest - nearest < DEPTH_EDGE_SIGMAS * noise * depth_sigma(nearest):
        return np.nan
    z = (1 - b) * ((1 - a) * z00 + a * z01) + b * ((1 - a) * z10 + a * z11)
    return float(z)


@compiled
def depth_at(depth: Float32, u: Float64, v: Float64, noise: float = 1.0) -> Float64:
    """``sample_depth`` at each of the pixels u, v [N]; float64 [N]."""
    z = np.empty(len(u))
    for i in range(len(u)):
        z[i] = sample_depth(depth, u[i], v[i], noise)
    return z


@compiled
def surface_tolerance(z: float, noise: float) -> float:
    """Maximum difference from depth z of another depth of the same surface, metres.

    This exceeds the noise: images are not taken at exactly the same time, and surfaces recede.
    ``noise`` is that of depth, relative to ``depth_sigma``.
    """
    return SURFACE_SIGMAS * noise * depth_sigma(z) + RECEDING * z
