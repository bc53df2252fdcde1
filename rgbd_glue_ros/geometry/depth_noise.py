"""The noise of a depth image, relative to what is expected, from the image alone.

Most of an image is of smooth surfaces: in inverse depth a plane has no second difference along
rows and columns, so the median of these is of noise.
"""

from __future__ import annotations

import math

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry.contrast import NORMAL_MEDIAN
from rgbd_glue_ros.geometry.depth import depth_sigma
from rgbd_glue_ros.geometry.normals import REFERENCE_PX
from rgbd_glue_ros.types import Float32, Float64

# Pixels from one depth to the next of a second difference, in an image of 640x480: noise of
# neighbours that stereo matching or a filter smooths is alike.
_APART_PX = 4
# Of so many rows and columns one is looked at, in an image of 640x480.
_STRIDE_PX = 6
# Whole steps of disparity look like noise of one standard deviation.
_OF_STEPS = 1.0
# Second differences that have to be known.
_FEWEST = 1000


def depth_noise_of(depth: Float32) -> float:
    """The standard deviation of an image's depth, relative to ``depth_sigma``; at least 1.

    Args:
        depth: float32 [H, W], metres, NaN where unknown.

    Returns:
        1 if depth is as accurate as expected, or too little of it is known.
    """
    scale = math.sqrt(depth.size / REFERENCE_PX)
    apart, stride = max(1, round(_APART_PX * scale)), max(1, round(_STRIDE_PX * scale))
    differences = _second_differences(depth, apart, stride)
    if len(differences) < _FEWEST:
        return 1.0
    middle = len(differences) // 2
    noise = float(np.partition(differences, middle)[middle]) / NORMAL_MEDIAN
    return math.sqrt(max(noise**2 - _OF_STEPS**2, 1.0))


@compiled
def _second_differences(depth: Float32, apart: int, stride: int) -> Float64:
    """Absolute second differences of inverse depth, each in standard deviations of its own [N]."""
    height, width = depth.shape
    found = np.empty(2 * ((height // stride) + 1) * ((width // stride) + 1))
    n = 0
    for v in range(0, height, stride):
        for u in range(0, width, stride):
            z = depth[v, u]
            # the standard deviation of inverse depth, times that of 1 - 2 + 1
            sigma = math.sqrt(6.0) * depth_sigma(z) / (z * z)
            if apart <= u < width - apart:
                along_u = 1 / depth[v, u - apart] - 2 / z + 1 / depth[v, u + apart]
                if math.isfinite(along_u):
                    found[n] = abs(along_u) / sigma
                    n += 1
            if apart <= v < height - apart:
                along_v = 1 / depth[v - apart, u] - 2 / z + 1 / depth[v + apart, u]
                if math.isfinite(along_v):
                    found[n] = abs(along_v) / sigma
                    n += 1
    return found[:n]
