"""Whether depth is registered to colour: whether edges of the one lie on edges of the other.

Where a surface ends before another one, brightness mostly changes, too. Depth in the pixels of its
own camera, which has another focal length and sits beside the one for colour, has its edges
elsewhere. So the edges of depth are laid over those of colour, magnified and shifted in steps, as
in calibration by the alignment of edges (Levinson and Thrun 2013): where depth is registered the
picture fits best as it is.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import Float32, Float64, UInt8, View

logger = logging.getLogger(__name__)

# Every so many rows and columns of the depth image are searched for ends of surfaces.
_SPACING_PX = 4
# Unknown depth beside the end of a surface, as the shadow of a projector is, at most this wide.
_GAP_PX = 30
# Part of its depth that lies between a surface and the one behind it, at least.
_STEP = 0.1
# How colour may be magnified and shifted against depth.
_SCALES = np.linspace(0.85, 1.15, 11)
_SHIFTS_PX = np.linspace(-15.0, 15.0, 11)
_AS_IT_IS = len(_SCALES) // 2, len(_SHIFTS_PX) // 2, len(_SHIFTS_PX) // 2
# Gradients beyond this, in grey levels a pixel, are edges all the same.
_EDGE = 12.0
_EDGE_SIGMA_PX, _AROUND_PX = 1.5, 21
# From the centre of an image of 640 columns, for saying what a magnification is in pixels.
_HALF_WAY_PX = 160.0
# A view with fewer ends of surfaces says nothing, and of more as many are enough. So many views
# that say something decide, which must differ by this much, metres and radians added.
_MIN_ENDS, _ENOUGH_ENDS = 150, 2000
_VIEWS, _APART = 8, 0.05
# What is laid elsewhere has to fit this many times better, as well as this, and by so many standard
# deviations of all that were tried: edges of other rooms fit somewhere by 3.9, and by 0.08.
_BETTER, _LEAST_FIT, _SIGMAS = 2.0, 0.12, 4.0


@dataclass(frozen=True)
class DepthColorCheck:
    """How well edges of depth and colour fit, magnified and shifted, over some views.

    Attributes:
        score: float64 [S, U, V], mean over the views, for scales and shifts along u and v.
        views: how many.
        T_track_camera: of the last view, float64 [4, 4]; None before the first.
    """

    score: Float64
    views: int = 0
    T_track_camera: Float64 | None = None

    @staticmethod
    def start() -> DepthColorCheck:
        """Before anything was seen."""
        return DepthColorCheck(np.zeros((len(_SCALES), len(_SHIFTS_PX), len(_SHIFTS_PX))))

    def needs_view_from(self, T_track_camera: Float64) -> bool:
        """Whether a view from there would tell anything new."""
        if self.views >= _VIEWS:
            return False
        if self.T_track_camera is None:
            return True
        return se3.difference(self.T_track_camera, T_track_camera) > _APART

    def after_view(self, view: View, T_track_camera: Float64) -> DepthColorCheck:
        """The check after another view. Logs a warning when it is known to be wrong."""
        beside, above = _ends_of_surfaces(view.depth)
        count = len(beside) + len(above)
        if count < _MIN_ENDS:
            return replace(self, T_track_camera=T_track_camera)
        along_u, along_v = _contrasts(view.grey)
        K = view.intrinsics
        score = _scores(beside, along_u, K.cx, K.cy, _SCALES, _SHIFTS_PX)
        score = (score + _scores(above, along_v, K.cx, K.cy, _SCALES, _SHIFTS_PX)) / count
        views = self.views + 1
        after = DepthColorCheck(self.score + (score - self.score) / views, views, T_track_camera)
        if after.offset_px is not None:
            logger.warning(
                "depth is not registered to colour: its edges are off by %.0f pixels; give the "
                "aligned or registered depth topic. Colour counts for less from here on",
                after.offset_px,
            )
        return after

    @cached_property
    def offset_px(self) -> float | None:
        """How far edges of depth are from those of colour, in pixels, half way to the border.

        None where depth is registered, and as long as too little was seen to tell.
        """
        s, i, j = np.unravel_index(int(np.argmax(self.score)), self.score.shape)
        best = self.score[s, i, j]
        scale, right, down = _AS_IT_IS
        # images that are not taken at quite the same time differ by a few pixels
        as_it_is = self.score[scale, right - 1 : right + 2, down - 1 : down + 2].max()
        if (
            self.views < _VIEWS
            or best < max(_LEAST_FIT, _BETTER * as_it_is)
            or best < self.score.mean() + _SIGMAS * self.score.std()
        ):
            return None
        magnified = abs(_SCALES[s] - 1.0) * _HALF_WAY_PX
        return float(np.hypot(np.hypot(_SHIFTS_PX[i], _SHIFTS_PX[j]), magnified))


def _ends_of_surfaces(depth: Float32) -> tuple[Float32, Float32]:
    """Pixels where a surface ends before another one: beside it, and above or below it.

    Returns:
        Column and row, float32 [N, 2] and [M, 2].
    """
    beside = _ends_along_rows(depth, _SPACING_PX, _GAP_PX, _STEP)
    above = _ends_along_rows(np.ascontiguousarray(depth.T), _SPACING_PX, _GAP_PX, _STEP)
    thinned = slice(None, None, (len(beside) + len(above)) // _ENOUGH_ENDS + 1)
    return beside[thinned], above[thinned, ::-1]


@compiled
def _ends_along_rows(depth: Float32, spacing: int, gap: int, step: float) -> Float32:
    """Column and row, float32 [N, 2], of the nearer of two neighbours in a row."""
    height, width = depth.shape
    found = np.empty((height // spacing * width + width, 2), np.float32)
    n = 0
    for v in range(0, height, spacing):
        last = -1
        for u in range(width):
            z = depth[v, u]
            if not z > 0.0:
                continue
            if last >= 0 and u - last <= gap:
                before = depth[v, last]
                if max(z, before) > min(z, before) * (1.0 + step):
                    found[n, 0], found[n, 1] = last if before < z else u, v
                    n += 1
            last = u
    return found[:n]


def _contrasts(grey: UInt8) -> tuple[Float32, Float32]:
    """How much more the brightness changes along u and along v than around, at half the size."""
    small = cv2.pyrDown(grey)
    along_u, along_v = (
        np.minimum(np.abs(cv2.Scharr(small, cv2.CV_32F, du, 1 - du)) / 32.0, _EDGE) for du in (1, 0)
    )
    return _above_surroundings(along_u), _above_surroundings(along_v)


def _above_surroundings(edges: Float32) -> Float32:
    here = cv2.GaussianBlur(edges, (0, 0), _EDGE_SIGMA_PX)
    around = cv2.blur(edges, (_AROUND_PX, _AROUND_PX))
    return np.asarray((here - around) / (around + 1.0), np.float32)


@compiled
def _scores(
    ends: Float32, contrast: Float32, cx: float, cy: float, scales: Float64, shifts: Float64
) -> Float64:
    """Sum of the contrast at the ends of surfaces, float64 [S, U, V], for each scale and shift."""
    height, width = contrast.shape
    score = np.zeros((len(scales), len(shifts), len(shifts)))
    for n in range(len(ends)):
        for s in range(len(scales)):
            u = cx + scales[s] * (ends[n, 0] - cx)
            v = cy + scales[s] * (ends[n, 1] - cy)
            for i in range(len(shifts)):
                # pyrDown centres pixel i on pixel 2 i
                column = int(np.floor((u + shifts[i]) / 2 + 0.5))
                if column < 0 or column >= width:
                    continue
                for j in range(len(shifts)):
                    row = int(np.floor((v + shifts[j]) / 2 + 0.5))
                    if 0 <= row < height:
                        score[s, i, j] += contrast[row, column]
    return score
