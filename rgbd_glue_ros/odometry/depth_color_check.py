"""Checks whether depth is registered to colour, by whether their edges coincide.

Where a surface ends in front of another one, brightness usually changes too. A depth camera has a
different focal length and position than the colour camera, so in unregistered depth edges lie
elsewhere. Depth edges are overlaid on colour edges, magnified and shifted in steps, as in
calibration by edge alignment (Levinson and Thrun 2013). Registered depth fits best unchanged.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.reduction import reduced
from rgbd_glue_ros.types import Float32, Float64, RgbdFrame, UInt8, View

logger = logging.getLogger(__name__)

# Larger images are reduced first: what is tried below is meant for images of about 640 columns.
_MAX_WIDTH_PX = 848
# Depth edges are searched for in every fourth row and column.
_SPACING_PX = 4
# Widest gap of unknown depth across a depth edge. Projectors and stereo cameras cause such shadows.
_GAP_PX = 30
# Least step of a depth edge, as a fraction of the nearer depth.
_STEP = 0.1
# Magnifications of depth against colour that are tried.
_SCALES = np.linspace(0.85, 1.15, 11)
# Shifts of depth against colour that are tried, along u and along v.
_SHIFTS_PX = np.linspace(-15.0, 15.0, 11)
# The index of the identity in the grid of these.
_IDENTITY = len(_SCALES) // 2, len(_SHIFTS_PX) // 2, len(_SHIFTS_PX) // 2
# Gradients are clipped here, grey levels per pixel, so that one strong edge does not outweigh many.
_STRONGEST_EDGE = 12.0
# Blur of colour edges: the steps of _SHIFTS_PX are 3 pixels, at half the size 1.5.
_EDGE_SIGMA_PX = 1.5
# Side of the neighbourhood that an edge must stand out from, at half the size.
_SURROUNDINGS_PX = 21
# Distance from the centre, a quarter of 640 columns, at which a magnification is stated in pixels.
_QUARTER_WIDTH_PX = 160.0
# A view with fewer depth edges is skipped.
_MIN_EDGES = 150
# If a view has more, this many are used.
_ENOUGH_EDGES = 2000
# Views that decide.
_VIEWS = 8
# Least motion between two such views, metres and radians added.
_APART = 0.05
# Another place has to fit this many times better than the identity.
_BETTER = 2.0
# The least accepted score. Overlaid edges of different rooms reached 0.08.
_LEAST_SCORE = 0.12
# The best score has to stand out by this many standard deviations of all. Other rooms reached 3.9.
_OUTSTANDING_SIGMAS = 4.0


@dataclass(frozen=True)
class DepthColorCheck:
    """How well depth edges fit colour edges, for each magnification and shift, over several views.

    Attributes:
        score: float64 [S, U, V], mean over the views, for scales and shifts along u and v.
        views: the number of views.
        T_track_camera: pose of the last view, float64 [4, 4]; None before the first.
    """

    score: Float64
    views: int = 0
    T_track_camera: Float64 | None = None

    @staticmethod
    def start() -> DepthColorCheck:
        """The check before any view."""
        return DepthColorCheck(np.zeros((len(_SCALES), len(_SHIFTS_PX), len(_SHIFTS_PX))))

    def needs(self, view: View, T_track_camera: Float64) -> bool:
        """Whether a view from that pose would add information."""
        if self.views >= _VIEWS or not _is_of_one_moment(view):
            return False
        if self.T_track_camera is None:
            return True
        return se3.difference(self.T_track_camera, T_track_camera) > _APART

    def after_view(self, view: View, T_track_camera: Float64) -> DepthColorCheck:
        """The check after another view. Logs a warning once depth is known to be unregistered."""
        view, pixels_per_pixel = _reduced(view)
        along_rows, along_columns = _depth_edges(view.depth)
        count = len(along_rows) + len(along_columns)
        if count < _MIN_EDGES:
            return replace(self, T_track_camera=T_track_camera)
        contrast_u, contrast_v = _contrasts(view.grey)
        K = view.intrinsics
        score = _scores(along_rows, contrast_u, K.cx, K.cy, _SCALES, _SHIFTS_PX)
        score = (
            score + _scores(along_columns, contrast_v, K.cx, K.cy, _SCALES, _SHIFTS_PX)
        ) / count
        views = self.views + 1
        after = DepthColorCheck(self.score + (score - self.score) / views, views, T_track_camera)
        if after.offset_px is not None:
            logger.warning(
                "depth is not registered to colour: its edges are off by %.0f pixels; give the "
                "aligned or registered depth topic. Colour counts for less from here on",
                after.offset_px * pixels_per_pixel,
            )
        return after

    @cached_property
    def offset_px(self) -> float | None:
        """Distance between edges of depth and colour, half way to the border.

        In pixels of an image of about 640 columns, to which larger ones are reduced. None if depth
        is registered, or while there are too few views to decide.
        """
        s, i, j = np.unravel_index(int(np.argmax(self.score)), self.score.shape)
        best = self.score[s, i, j]
        scale, right, down = _IDENTITY
        # images that are not taken at exactly the same time differ by a few pixels
        at_identity = self.score[scale, right - 1 : right + 2, down - 1 : down + 2].max()
        if (
            self.views < _VIEWS
            or best < max(_LEAST_SCORE, _BETTER * at_identity)
            or best < self.score.mean() + _OUTSTANDING_SIGMAS * self.score.std()
        ):
            return None
        magnified = abs(_SCALES[s] - 1.0) * _QUARTER_WIDTH_PX
        return float(np.hypot(np.hypot(_SHIFTS_PX[i], _SHIFTS_PX[j]), magnified))


def _reduced(view: View) -> tuple[View, int]:
    """A view of about 640 columns or fewer, and the side of the block that became a pixel."""
    frame = reduced(RgbdFrame(0, view.grey, view.depth, view.intrinsics), _MAX_WIDTH_PX)
    small = replace(view, grey=frame.color, depth=frame.depth, intrinsics=frame.intrinsics)
    return small, view.intrinsics.width // frame.intrinsics.width


def _is_of_one_moment(view: View) -> bool:
    """Whether the camera hardly moved between the colour image and the depth image."""
    speed = np.linalg.norm(view.twist[:3]) + np.linalg.norm(view.twist[3:])
    moved_px = view.intrinsics.fx * speed * abs(view.depth_delay)
    return bool(moved_px <= _SHIFTS_PX[1] - _SHIFTS_PX[0])


def _depth_edges(depth: Float32) -> tuple[Float32, Float32]:
    """Pixels where a surface ends in front of another one, along rows and along columns.

    Returns:
        Column and row, float32 [N, 2] and [M, 2].
    """
    along_rows = _edges_along_rows(depth, _SPACING_PX, _GAP_PX, _STEP)
    along_columns = _edges_along_rows(np.ascontiguousarray(depth.T), _SPACING_PX, _GAP_PX, _STEP)
    thinned = slice(None, None, (len(along_rows) + len(along_columns)) // _ENOUGH_EDGES + 1)
    return along_rows[thinned], along_columns[thinned, ::-1]


@compiled
def _edges_along_rows(depth: Float32, spacing: int, gap: int, step: float) -> Float32:
    """Column and row, float32 [N, 2], of the nearer of two neighbours in a row."""
    height, width = depth.shape
    edges = np.empty((height // spacing * width + width, 2), np.float32)
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
                    edges[n, 0], edges[n, 1] = last if before < z else u, v
                    n += 1
            last = u
    return edges[:n]


def _contrasts(grey: UInt8) -> tuple[Float32, Float32]:
    """How much more brightness changes along u and v than in the surroundings, at half the size."""
    small = cv2.pyrDown(grey)
    along_u, along_v = (
        np.minimum(np.abs(cv2.Scharr(small, cv2.CV_32F, du, 1 - du)) / 32.0, _STRONGEST_EDGE)
        for du in (1, 0)
    )
    return _above_surroundings(along_u), _above_surroundings(along_v)


def _above_surroundings(gradient: Float32) -> Float32:
    here = cv2.GaussianBlur(gradient, (0, 0), _EDGE_SIGMA_PX)
    around = cv2.blur(gradient, (_SURROUNDINGS_PX, _SURROUNDINGS_PX))
    return np.asarray((here - around) / (around + 1.0), np.float32)


@compiled
def _scores(
    edges: Float32, contrast: Float32, cx: float, cy: float, scales: Float64, shifts: Float64
) -> Float64:
    """Sum of the contrast at depth edges, float64 [S, U, V], for each scale and shift."""
    height, width = contrast.shape
    score = np.zeros((len(scales), len(shifts), len(shifts)))
    for n in range(len(edges)):
        for s in range(len(scales)):
            u = cx + scales[s] * (edges[n, 0] - cx)
            v = cy + scales[s] * (edges[n, 1] - cy)
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
