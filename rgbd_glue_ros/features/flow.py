"""Keypoints of the target frame tracked into the source frame by optical flow.

At camera rate this is the cheapest visual feature and the most exact: keypoints are detected in
keyframes only, and their positions in every other frame are found to a fraction of a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.camera import back_project, depth_at, project
from rgbd_glue_ros.config import FeaturesConfig
from rgbd_glue_ros.features.visual import View, VisualMatches
from rgbd_glue_ros.se3 import inverse, transform
from rgbd_glue_ros.types import Float32, Float64, Int64, UInt8

_WINDOW = (17, 17)
_LEVELS = 3
_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.02)
# A keypoint tracked there and back that ends this far from its start, pixels, was lost on the way.
_ROUND_TRIP_PX = 0.7
_SPACING_PX = 12
_QUALITY = 0.005


@dataclass(frozen=True)
class TrackedView:
    """A frame to track in, and the keypoints to track from it, found when first asked for."""

    view: View
    count: int

    @cached_property
    def keypoints(self) -> tuple[Float32, Float64]:
        """Corners with known depth: pixels [N, 2] and points [N, 3] in the optical frame."""
        corners = cv2.goodFeaturesToTrack(
            self.view.grey, self.count, _QUALITY, _SPACING_PX, blockSize=5
        )
        if corners is None:
            return np.empty((0, 2), np.float32), np.empty((0, 3))
        uv = corners.reshape(-1, 2).astype(np.float32)
        z = depth_at(self.view.depth, uv)
        known = np.isfinite(z)
        return uv[known], back_project(uv[known], z[known], self.view.intrinsics)


@dataclass(frozen=True)
class Tracked:
    """Keypoints of a target found again in a source.

    Attributes:
        rows: int64 [N], of the target's keypoints.
        uv: float32 [N, 2], where the source sees them.
        round_trip: float64 [N], distance between start and end of tracking there and back, pixels.
    """

    rows: Int64
    uv: Float32
    round_trip: Float64


def track(target: TrackedView, source: View, T_target_source: Float64 | None) -> Tracked:
    """Pyramidal Lucas-Kanade from target to source (Bouguet 2001), checked by tracking back.

    Args:
        target: the frame whose keypoints are tracked.
        source: the frame to find them in.
        T_target_source: a guess, float64 [4, 4], that says where to start; None for no motion.

    Returns:
        The keypoints that were found and led back to where they came from.
    """
    uv, points = target.keypoints
    if len(uv) == 0:
        return Tracked(np.empty(0, np.int64), uv, np.empty(0))
    guess = uv
    if T_target_source is not None:
        predicted = project(transform(inverse(T_target_source), points), source.intrinsics)
        known = np.isfinite(predicted).all(axis=1)
        guess = np.where(known[:, None], predicted, uv).astype(np.float32)
    found_uv, found = _lucas_kanade(target.view.grey, source.grey, uv, guess)
    back, found_back = _lucas_kanade(source.grey, target.view.grey, found_uv, uv)
    round_trip = np.linalg.norm(back - uv, axis=1).astype(np.float64)
    height, width = source.grey.shape
    inside = ((found_uv >= 0) & (found_uv <= (width - 1, height - 1))).all(axis=1)
    rows = np.flatnonzero(found & found_back & inside & (round_trip <= _ROUND_TRIP_PX))
    return Tracked(rows, found_uv[rows], round_trip[rows])


class FlowFeature:
    """Tracks as a visual feature: matches need no descriptors."""

    def __init__(self, config: FeaturesConfig) -> None:
        self._config = config

    def extract(self, view: View) -> TrackedView:
        """The frame itself: only keyframes are searched for keypoints."""
        return TrackedView(view, self._config.keypoints)

    def match(
        self, source: TrackedView, target: TrackedView, prior: Float64 | None
    ) -> VisualMatches:
        """Tracks from target to source, more trusted the better they lead back."""
        tracked = track(target, source.view, prior)
        uv, _ = target.keypoints
        return VisualMatches(tracked.uv, uv[tracked.rows], 1.0 - tracked.round_trip)


def _lucas_kanade(
    start: UInt8, end: UInt8, uv: Float32, guess: Float32
) -> tuple[Float32, NDArray[np.bool_]]:
    tracked, status, _ = cv2.calcOpticalFlowPyrLK(
        start,
        end,
        uv,
        guess.copy(),
        winSize=_WINDOW,
        maxLevel=_LEVELS,
        criteria=_CRITERIA,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        minEigThreshold=1e-4,
    )
    return np.asarray(tracked, np.float32), status.ravel().astype(bool)
