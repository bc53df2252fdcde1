"""The optimum of a pose graph that grows, by iSAM2 (Kaess et al. 2012)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.slam.optimiser import (
    TRUSTED,
    between_factor,
    fixed_factor,
    load_gtsam,
    unlinked,
)
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
        self._isam = self._new_isam()
        self._solved = self._gtsam.NonlinearFactorGraph()
        self._poses: dict[int, Float64] = {}
        self._begin()

    @staticmethod
    def check(edges: Iterable[PoseGraphEdge]) -> None:
        """Refuses edges that would keep any graph from its optimum.

        Raises:
            InputError: there is no optimum with one of them alone.
        """
        for edge in edges:
            alone = IncrementalOptimiser()
            alone.add(0, np.eye(4))
            alone.add(1, edge.T_parent_child)
            alone.add_edge(replace(edge, parent=0, child=1))
            alone.update()

    def _new_isam(self) -> Any:
        params = self._gtsam.ISAM2Params()
        params.setRelinearizeThreshold(_RELINEARISE_BEYOND)
        params.relinearizeSkip = 1
        # for long chains Cholesky runs out of digits
        params.setFactorization("QR")
        return self._gtsam.ISAM2(params)

    def _begin(self) -> None:
        self._new_keyframes: list[tuple[int, Float64]] = []
        self._new_edges: list[PoseGraphEdge] = []

    def add(self, number: int, T_map_camera: Float64) -> None:
        """Adds a keyframe at its assumed pose; the first is fixed there."""
        self._new_keyframes.append((number, T_map_camera))

    def add_edge(self, edge: PoseGraphEdge) -> None:
        """Adds an edge between keyframes that were added."""
        self._new_edges.append(edge)

    def update(self) -> dict[int, Float64]:
        """The poses T_map_camera [4, 4] of all keyframes, including recent additions.

        Raises:
            InputError: there is no optimum, as where no edge leads to a keyframe. What was added
                since the update before is dropped, and the graph is as it was.
        """
        try:
            self._check_linked()
            factors = self._factors()
            self._isam.update(factors, self._initial())
            poses = self._estimate()
        except Exception as error:
            # iSAM2 keeps a part of what it could not solve, and would fail for ever
            self._restore()
            # GTSAM says what is wrong, and then at length what it means
            why = (str(error).strip() or type(error).__name__).splitlines()[0]
            cause = f"has no optimum with the new keyframe or edge, which is left out ({why})"
            remedy = "have this package's odometry publish them"
            raise InputError("the pose graph", cause, remedy) from error
        finally:
            self._begin()
        self._solved.push_back(factors)
        self._poses = poses
        return poses

    def _check_linked(self) -> None:
        """GTSAM takes a keyframe without an edge, and fails once an edge leads on from there."""
        numbers = [number for number, _ in self._new_keyframes]
        lost = unlinked(numbers, self._new_edges, self._poses or numbers[:1])
        if lost:
            raise ValueError(f"no edge links keyframe {lost[0]} to the others")

    def _factors(self) -> Any:
        factors = self._gtsam.NonlinearFactorGraph()
        if not self._poses:
            for number, T in self._new_keyframes[:1]:
                factors.add(fixed_factor(self._gtsam, number, T))
        for edge in self._new_edges:
            factors.add(self._factor(edge))
        return factors

    def _factor(self, edge: PoseGraphEdge) -> Any:
        factor = between_factor(self._gtsam, edge)
        if edge.origin in TRUSTED:
            return factor
        noise = self._gtsam.noiseModel
        robust = noise.Robust.Create(
            noise.mEstimator.Cauchy.Create(_ROBUST_SIGMAS), factor.noiseModel()
        )
        T = self._gtsam.Pose3(edge.T_parent_child)
        return self._gtsam.BetweenFactorPose3(edge.parent, edge.child, T, robust)

    def _initial(self) -> Any:
        values = self._gtsam.Values()
        for number, T in self._new_keyframes:
            values.insert(number, self._gtsam.Pose3(T))
        return values

    def _estimate(self) -> dict[int, Float64]:
        estimate = self._isam.calculateEstimate()
        keys = estimate.keys()
        poses = {int(key): np.asarray(estimate.atPose3(key).matrix()) for key in keys}
        if not all(np.isfinite(T).all() for T in poses.values()):
            raise ArithmeticError("a pose is not finite")
        return poses

    def _restore(self) -> None:
        """Solves anew what was solved before, from where that ended."""
        values = self._gtsam.Values()
        for number, T in self._poses.items():
            values.insert(number, self._gtsam.Pose3(T))
        self._isam = self._new_isam()
        self._isam.update(self._solved, values)
