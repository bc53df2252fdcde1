"""How well the edges of a depth image fit those of a colour image, laid over them in many ways."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import cv2
import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.types import Float32, Float64, UInt8, View

# Depth edges are searched for in every fourth row and column.
_SPACING_PX = 4
# Widest gap of unknown depth across a depth edge. Projectors and stereo cameras cause such shadows.
_GAP_PX = 30
# Least step of a depth edge, as a fraction of the nearer depth.
_STEP = 0.1
# What cv2.Scharr returns for a gradient of one grey level per pixel.
_SCHARR_SCALE = 32.0
# Gradients are clipped here, grey levels per pixel, so that one strong edge does not outweigh many.
_STRONGEST_EDGE = 12.0
# Blur of colour edges: the steps of shifts are 3 pixels, at half the size 1.5.
_EDGE_SIGMA_PX = 1.5
# Side of the neighbourhood that an edge must stand out from, at half the size.
_SURROUNDINGS_PX = 21
# A view with fewer depth edges says nothing.
_MIN_EDGES = 150
# If a view has more, this many are used.
_ENOUGH_EDGES = 2000
# Distance from the centre, a quarter of 640 columns, at which a magnification is stated in pixels.
_QUARTER_WIDTH_PX = 160.0


class Orientation(Enum):
    """How one of two images may lie on the other, but for its scale and a shift."""

    ALIKE = "alike"
    MIRRORED = "mirrored"
    UPSIDE_DOWN = "upside down"


@dataclass(frozen=True)
class Placement:
    """How a depth image lies on a colour image.

    Attributes:
        orientation: of the one image against the other.
        scale: magnification of depth about the centre.
        right: shift, pixels.
        down: shift, pixels.
    """

    orientation: Orientation
    scale: float
    right: float
    down: float

    @property
    def offset_px(self) -> float:
        """Distance between corresponding edges half way to the border, if oriented alike."""
        magnified = abs(self.scale - 1.0) * _QUARTER_WIDTH_PX
        return float(np.hypot(np.hypot(self.right, self.down), magnified))


@dataclass(frozen=True)
class Placements:
    """The placements to try: all combinations of some orientations, scales and shifts.

    Attributes:
        orientations: the first is that of registered depth.
        scales: float64 [S], with 1 in the middle.
        shifts: float64 [U], to the right and down, with 0 in the middle.
    """

    orientations: tuple[Orientation, ...]
    scales: Float64
    shifts: Float64

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """The shape of an array with a number for each."""
        return len(self.orientations), len(self.scales), len(self.shifts), len(self.shifts)

    @property
    def identity(self) -> tuple[int, int, int, int]:
        """The index of the placement of depth that is registered."""
        middle = len(self.shifts) // 2
        return 0, len(self.scales) // 2, middle, middle

    def at(self, index: int) -> Placement:
        """The placement with an index in the flattened array."""
        o, s, i, j = np.unravel_index(index, self.shape)
        right, down = float(self.shifts[i]), float(self.shifts[j])
        return Placement(self.orientations[o], float(self.scales[s]), right, down)


def overlay_scores(view: View, placements: Placements) -> Float64 | None:
    """How much more contrast colour has at depth edges than around them, for each placement.

    Args:
        view: of about 640 columns or fewer.
        placements: to try.

    Returns:
        float64 of their shape, the means over the edges; None if there are too few.
    """
    along_rows, along_columns = _depth_edges(view.depth)
    count = len(along_rows) + len(along_columns)
    if count < _MIN_EDGES:
        return None
    contrasts = _contrasts(view.grey)
    K, scales, shifts = view.intrinsics, placements.scales, placements.shifts
    scores = np.empty(placements.shape)
    for orientation, score in zip(placements.orientations, scores, strict=True):
        score[:] = sum(
            _scores(edges, _oriented(contrast, orientation), K.cx, K.cy, scales, shifts)
            for edges, contrast in zip((along_rows, along_columns), contrasts, strict=True)
        )
    return scores / count


def _oriented(image: Float32, orientation: Orientation) -> Float32:
    match orientation:
        case Orientation.ALIKE:
            return image
        case Orientation.MIRRORED:
            return np.ascontiguousarray(image[:, ::-1])
        case Orientation.UPSIDE_DOWN:
            return np.ascontiguousarray(image[::-1, ::-1])


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
        np.abs(cv2.Scharr(small, cv2.CV_32F, du, 1 - du)) / _SCHARR_SCALE for du in (1, 0)
    )
    return _above_surroundings(along_u), _above_surroundings(along_v)


def _above_surroundings(gradient: Float32) -> Float32:
    clipped = np.minimum(gradient, _STRONGEST_EDGE)
    here = cv2.GaussianBlur(clipped, (0, 0), _EDGE_SIGMA_PX)
    around = cv2.blur(clipped, (_SURROUNDINGS_PX, _SURROUNDINGS_PX))
    return np.asarray((here - around) / (around + 1.0), np.float32)


@compiled
def _scores(
    edges: Float32, contrast: Float32, cx: float, cy: float, scales: Float64, shifts: Float64
) -> Float64:
    """Sum of the contrast at depth edges, float64 [S, U, U], for each scale and shift."""
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
