"""From pixels to points: visual matches in 3D (section 3.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.features.visual import VisualMatches
from rgbd_glue_ros.geometry.motion_compensation import keypoints_to_points
from rgbd_glue_ros.types import Correspondences, Float32, Float64, Mask, View

PointsAt = Callable[[Float32], tuple[Float64, Mask]]
"""Takes pixels uv [N, 2] of a frame; gives points [M, 3] and which pixels [N] have one."""


def lift(
    matches: VisualMatches, source_points_at: PointsAt, target_points_at: PointsAt
) -> Correspondences:
    """Maps visual matches to 3D with the camera intrinsics (section 3.2), where depth is known."""
    source_points, source_known = source_points_at(matches.source_uv)
    target_points, target_known = target_points_at(matches.target_uv)
    return Correspondences(
        source_points[target_known[source_known]],
        target_points[source_known[target_known]],
        matches.weights[source_known & target_known],
    )


@dataclass(frozen=True, eq=False)
class KeypointPoints:
    """The points at the keypoints of a frame, in place of its depth image.

    Attributes:
        keys: uint64 [N], the keypoints' pixels as one number each, increasing.
        points: float64 [N, 3], metres; NaN where depth is unknown.
    """

    keys: np.ndarray[tuple[int], np.dtype[np.uint64]]
    points: Float64

    @staticmethod
    def of(uv: Float32, view: View) -> KeypointPoints:
        """The points of a view at its keypoints uv [N, 2]."""
        points = np.full((len(uv), 3), np.nan)
        known_points, known = keypoints_to_points(uv, view)
        points[known] = known_points
        keys = _keys(uv)
        order = np.argsort(keys, kind="stable")
        return KeypointPoints(keys[order], points[order])

    def at(self, uv: Float32) -> tuple[Float64, Mask]:
        """As ``PointsAt``, for keypoints.

        Raises:
            InputError: a pixel is not a keypoint of the frame.
        """
        keys = _keys(uv)
        rows = np.searchsorted(self.keys, keys)
        if len(keys) and (rows.max() == len(self.keys) or (self.keys[rows] != keys).any()):
            raise InputError(
                "features.visual",
                "matches pixels that are not among its keypoints",
                "match only keypoints, or leave out the method keypoints",
            )
        points = self.points[rows]
        known = np.isfinite(points[:, 2])
        return points[known], known


def _keys(uv: Float32) -> np.ndarray[tuple[int], np.dtype[np.uint64]]:
    """Pixels [N, 2] as one number each: the bits of both coordinates."""
    return np.ascontiguousarray(uv, np.float32).view(np.uint64)[:, 0]
