"""The optimum of a pose graph that grows, by iSAM2 (Kaess et al. 2012)."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.slam.optimiser import TRUSTED, between_factor, fixed_factor, load_gtsam
from rgbd_glue_ros.types import Float64, PoseGraphEdge

# Residuals beyond this many standard deviations lose weight (Cauchy): some loops may be false.
_ROBUST_SIGMAS = 3.0
_RELINEARISE_BEYOND = 0.01


class IncrementalOptimiser:
    """Takes keyframes and edges one by one; unchanged parts are not solved again."""

    def __init__(self) -> None:
        """Creates an empty graph.

        Raises:
            MissingExtraError: GTSAM is not installed.
        """
        self._gtsam = load_gtsam("mapping")
        params = self._gtsam.ISAM2Params()
        params.setRelinearizeThreshold(_RELINEARISE_BEYOND)
        params.relinearizeSkip = 1
        # for long chains Cholesky runs out of digits
        params.setFactorization("QR")
        self._isam = self._gtsam.ISAM2(params)
        self._begin()
        self._count = 0

    def _begin(self) -> None:
        self._factors = self._gtsam.NonlinearFactorGraph()
        self._values = self._gtsam.Values()

    def add(self, number: int, T_map_camera: Float64) -> None:
        """Adds a keyframe at its assumed pose; the first is fixed there."""
        self._values.insert(number, self._gtsam.Pose3(T_map_camera))
        if self._count == 0:
            self._factors.add(fixed_factor(self._gtsam, number, T_map_camera))
        self._count += 1

    def add_edge(self, edge: PoseGraphEdge) -> None:
        """Adds an edge between keyframes that were added."""
        factor = between_factor(self._gtsam, edge)
        if edge.origin not in TRUSTED:
            noise = self._gtsam.noiseModel
            robust = noise.Robust.Create(
                noise.mEstimator.Cauchy.Create(_ROBUST_SIGMAS), factor.noiseModel()
            )
            T = self._gtsam.Pose3(edge.T_parent_child)
            factor = self._gtsam.BetweenFactorPose3(edge.parent, edge.child, T, robust)
        self._factors.add(factor)

    def update(self) -> dict[int, Float64]:
        """The poses T_map_camera [4, 4] of all keyframes, including recent additions."""
        self._isam.update(self._factors, self._values)
        self._begin()
        estimate = self._isam.calculateEstimate()
        keys = estimate.keys()
        return {int(key): np.asarray(estimate.atPose3(key).matrix()) for key in keys}
