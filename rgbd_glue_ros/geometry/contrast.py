"""The contrast of an image: in the dark and in haze it is less than grey-level limits expect.

Those limits (what counts as a corner or a textured pixel) are for well-lit images. They shrink with
the contrast of edges, as long as edges stand out from noise: that of a bare wall is not texture.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from rgbd_glue_ros.types import Float32, Mask, UInt8, View

# Edges are detected in a small image: its pixels are means of many, and have less noise.
_LENGTH_PX = 160
# The fraction of pixels that counts as edges: those with the steepest gradients.
_EDGES = 0.05
# The steepest fraction of pixels limits the gain: no gradient may exceed black to white within two
# pixels, in grey levels per pixel.
_STEEPEST, _BLACK_TO_WHITE = 0.01, 255 / 2
# Edges have gradients of at least this many times the noise. With noise alone, the steepest are
# 1.8 times as steep; on an unevenly lit wall, 2 to 4 times.
_LEAST_OVER_NOISE = 4.0
# The steepest are up to 2.5 times as steep as the least steep of the edges, in light and in the
# dark. If they are more than this many times as steep, few pixels are of edges, and the others may
# be of a bare wall, whose noise limits must not shrink to.
_STEEPEST_OVER_EDGES = 3.0
# Grey levels: the noise that limits for well-lit images stand out from.
_NOISE_IN_GOOD_LIGHT = 1.75
# With every further multiple, limits may shrink by this further factor, down to the least contrast.
_GAIN_PER_MULTIPLE, _LEAST_CONTRAST = 2.0, 1 / 16
# Grey levels of lamps and windows, whose edges say nothing about the light elsewhere.
_OVEREXPOSED = 240
# Pixels of the small image that have to remain.
_FEWEST = 100
# Grey levels: rounding to whole ones causes an error of this size, even in the mean of some pixels.
_LEAST_NOISE = 0.2
# The surroundings of such a pixel in the small image: mixed pixels, and those its gradients reach.
_BESIDE = np.ones((5, 5), np.uint8)
# The second difference along both axes; Immerkaer's estimate of noise (1996) takes its mean, the
# median leaves out edges. Its standard deviation is 6 times that of the noise.
_CURVATURE = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)

NORMAL_MEDIAN = 0.6745
"""The median of the absolute value of a standard normal variable."""


def contrast_of(image: UInt8, well_lit_gradient: float) -> float:
    """The contrast of an image relative to a well-lit one.

    Args:
        image: uint8 [H, W].
        well_lit_gradient: minimum steepness of edges in a well-lit image of 160 pixels, grey levels
            per pixel; 0 treats every image as well lit.

    Returns:
        From 1/16 to 1; 1 for an image that shows only noise.
    """
    if well_lit_gradient == 0:
        return 1.0
    small = _shrunk(image)
    if min(small.shape) < 3:
        return 1.0
    along_u, along_v = small[1:-1, 2:] - small[1:-1, :-2], small[2:, 1:-1] - small[:-2, 1:-1]
    gradients = cv2.magnitude(along_u, along_v)[~_overexposed(small)] / 2
    if gradients.size < _FEWEST:
        return 1.0
    edges = _quantile(gradients, 1 - _EDGES)
    if edges >= well_lit_gradient:
        return 1.0
    steepest = _quantile(gradients, 1 - _STEEPEST)
    gain = _GAIN_PER_MULTIPLE * (edges / _noise(small) - _LEAST_OVER_NOISE)
    least = max(1 / max(gain, 1.0), steepest / _BLACK_TO_WHITE, _LEAST_CONTRAST)
    if steepest > _STEEPEST_OVER_EDGES * edges:
        of_steepest = steepest / (_STEEPEST_OVER_EDGES * well_lit_gradient)
        least = max(least, min(of_steepest, _noise(image) / _NOISE_IN_GOOD_LIGHT))
    return min(1.0, max(edges / well_lit_gradient, least))


def _overexposed(image: Float32) -> Mask:
    """Which pixels, except those at the border, are on or beside a lamp or a window."""
    bright = np.asarray(image >= _OVEREXPOSED, np.uint8)
    return np.asarray(cv2.dilate(bright, _BESIDE)[1:-1, 1:-1] > 0, np.bool_)


def well_lit(view: View) -> UInt8:
    """The image of a view as it would be in good light, uint8 [H, W]; unchanged if well lit."""
    if view.contrast == 1:
        return view.grey
    levels = (np.arange(256) - np.median(view.grey[::4, ::4])) / view.contrast + 128
    return np.asarray(cv2.LUT(view.grey, np.clip(levels, 0, 255).astype(np.uint8)), np.uint8)


def _shrunk(image: UInt8) -> Float32:
    """The image reduced to a longer side of at most 160 pixels; grey levels, float32."""
    shrink = min(1.0, _LENGTH_PX / max(image.shape))
    if shrink * min(image.shape) < 1:
        return image.astype(np.float32)
    size = (round(shrink * image.shape[1]), round(shrink * image.shape[0]))
    resized = cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(resized, np.float32)


def _noise(image: UInt8 | Float32) -> float:
    """The standard deviation of an image's noise, grey levels."""
    curvature = cv2.filter2D(image, cv2.CV_32F, _CURVATURE)[1:-1, 1:-1]
    some = np.abs(_thinned(curvature))
    return max(_quantile(some, 0.5) / NORMAL_MEDIAN / 6, _LEAST_NOISE)


def _thinned(image: Any) -> Any:
    """Every n-th row and column: a median needs no more than some ten thousand pixels."""
    step = -(-max(image.shape) // (2 * _LENGTH_PX))
    return image[::step, ::step]


def _quantile(values: Any, q: float) -> float:
    """The q-quantile of some values; NumPy's own takes ten times as long."""
    k = int(q * values.size)
    return float(np.partition(values, k, axis=None)[k])
