"""small_gicp (Koide 2024, MIT licence)."""

from __future__ import annotations

from typing import Any

import numpy as np

from rgbd_glue_ros.errors import MissingExtraError
from rgbd_glue_ros.experiments.peers.base import NoTransformError
from rgbd_glue_ros.geometry.camera import cloud
from rgbd_glue_ros.types import Float64, View

# The library's own values are for a car; these are their equivalents for a room at 2.5 cm.
_VOXEL_M = 0.025
_MAX_DISTANCE_M = 0.1
_ITERATIONS = 50


class SmallGicp:
    """Generalised ICP from the identity."""

    def __init__(self) -> None:
        try:
            import small_gicp  # noqa: PLC0415 - optional
        except ImportError as error:
            raise MissingExtraError("small_gicp", "bench", "the peer small_gicp") from error
        self._library = small_gicp

    def prepare(self, view: View) -> tuple[Any, Any]:
        """The thinned cloud with covariances, and its tree."""
        prepared: tuple[Any, Any] = self._library.preprocess_points(
            cloud(view.depth, view.intrinsics), downsampling_resolution=_VOXEL_M
        )
        return prepared

    def register(self, source: tuple[Any, Any], target: tuple[Any, Any]) -> Float64:
        """T_target_source, converged or not."""
        result = self._library.align(
            target[0],
            source[0],
            target[1],
            max_correspondence_distance=_MAX_DISTANCE_M,
            max_iterations=_ITERATIONS,
        )
        if not result.num_inliers:
            raise NoTransformError("no points correspond")
        return np.array(result.T_target_source, np.float64)
