"""Corrects drift when the camera returns to what it saw before.

Tracking compares a frame with the latest few keyframes, whose errors accumulate. A keyframe that
sees what a much earlier one saw is compared with that one too: their disagreement is drift. The
pose is corrected gradually, by a small fraction of the camera's own motion, so that it is as smooth
as before (REP-105) and stands still when the camera does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.gates import POSE_GATE, mahalanobis_squared
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.keyframe import Anchor, NewestKeyframe
from rgbd_glue_ros.odometry.keyframe_edges import revisit_edge
from rgbd_glue_ros.odometry.pose_covariance import PoseErrors
from rgbd_glue_ros.odometry.pose_refinement import COARSE_LEVELS
from rgbd_glue_ros.parameters import RefineConfig
from rgbd_glue_ros.refinement.gauss_newton import refine
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.types import Float64, PoseGraphEdge


@dataclass(frozen=True)
class DriftCorrection:
    """Correction of the drift of tracked poses, multiplied on the left.

    Attributes:
        T_odom_track: the current correction, float64 [4, 4].
        T_odom_track_known: the correction of all drift that is known, which it moves towards.
    """

    T_odom_track: Float64
    T_odom_track_known: Float64

    @staticmethod
    def at(T_odom_track: Float64) -> DriftCorrection:
        """A correction that is already complete."""
        return DriftCorrection(T_odom_track, T_odom_track)

    def after_shift(self, T_shift: Float64) -> DriftCorrection:
        """The drift after tracked poses were shifted, so that published ones are not.

        Args:
            T_shift: float64 [4, 4], multiplied on the left of tracked poses.
        """
        return replace(self, T_odom_track=self.T_odom_track @ se3.inverse(T_shift))

    def advanced(self, T_before: Float64, T_now: Float64, rate: float) -> DriftCorrection:
        """The drift after the camera has moved.

        Args:
            T_before: T_track_camera, float64 [4, 4].
            T_now: T_track_camera, later.
            rate: maximum correction of the pose, as a fraction of the camera's motion, metres and
                radians added.
        """
        corrected = self.T_odom_track @ T_now
        remaining = se3.log(se3.inverse(corrected) @ self.T_odom_track_known @ T_now)
        length = float(np.linalg.norm(remaining[:3]) + np.linalg.norm(remaining[3:]))
        allowed = rate * se3.difference(T_before, T_now)
        if length <= allowed:
            return DriftCorrection.at(self.T_odom_track_known)
        moved = corrected @ se3.exp(remaining * (allowed / length))
        return DriftCorrection(moved @ se3.inverse(T_now), self.T_odom_track_known)

    def pose_in_odom(self, T_track_camera: Float64, covariance: Float64) -> tuple[Float64, Float64]:
        """The published pose: a tracked one with the correction applied.

        Args:
            T_track_camera: as tracked, float64 [4, 4].
            covariance: float64 [6, 6] of it, perturbation on the left, track frame.

        Returns:
            T_odom_camera [4, 4] and its covariance [6, 6] as in nav_msgs/Odometry, including drift
            that is known but not yet corrected.
        """
        T_odom_camera = self.T_odom_track @ T_track_camera
        T_known = self.T_odom_track_known @ T_track_camera
        turn = se3.rotation_vector(T_known @ se3.inverse(T_odom_camera))
        off = np.concatenate([T_known[:3, 3] - T_odom_camera[:3, 3], turn])
        in_odom = self.covariance_in_odom(covariance)
        return T_odom_camera, se3.pose_covariance(T_odom_camera, in_odom) + np.outer(off, off)

    def covariance_in_odom(self, covariance: Float64) -> Float64:
        """A covariance [6, 6] of the track frame in the odom frame, both on the left of poses."""
        return se3.transported_covariance(self.T_odom_track, covariance)


@dataclass(frozen=True)
class Revisit:
    """What the comparison of a keyframe with much earlier ones shows.

    Attributes:
        T_odom_track_known: float64 [4, 4], the correction of all drift that is known after it.
        edges: measured by it.
    """

    T_odom_track_known: Float64
    edges: tuple[PoseGraphEdge, ...]


def revisit(
    keyframe: NewestKeyframe,
    anchors: Sequence[Anchor],
    T_odom_track_known: Float64,
    refine_config: RefineConfig,
    acceptance: Acceptance,
    errors: PoseErrors,
) -> Revisit:
    """Compares a keyframe with much earlier ones.

    What a single anchor indicates may be its own error. What several indicate is accepted if they
    disagree by less than they correct.

    Args:
        keyframe: the newest.
        anchors: keyframes that see the same part of the room.
        T_odom_track_known: float64 [4, 4], the correction of all drift that was known before.
        refine_config: how they are compared.
        acceptance: the evidence that the result needs.
        errors: of the camera.
    """
    problem = RefinementProblem(keyframe.model, keyframe.features.view, refine_config)
    compared = [
        _compared(
            keyframe,
            anchor,
            T_odom_track_known,
            replace(problem, model=anchor.model),
            acceptance,
            errors,
        )
        for anchor in anchors
    ]
    comparisons = [comparison for comparison in compared if comparison is not None]
    edges = tuple(comparison.edge for comparison in comparisons)
    corrections = np.array([comparison.correction for comparison in comparisons])
    if not _agree(corrections):
        return Revisit(T_odom_track_known, edges)
    return Revisit(se3.exp(corrections.mean(axis=0)) @ T_odom_track_known, edges)


@dataclass(frozen=True)
class _Comparison:
    """Comparison of a keyframe with one anchor.

    Attributes:
        correction: float64 [6], the twist that corrects the drift, on the left.
        edge: between the two.
    """

    correction: Float64
    edge: PoseGraphEdge


def _compared(
    keyframe: NewestKeyframe,
    anchor: Anchor,
    T_odom_track_known: Float64,
    problem: RefinementProblem,
    acceptance: Acceptance,
    errors: PoseErrors,
) -> _Comparison | None:
    """The comparison with one anchor; None if it is not accepted."""
    T_odom_camera = T_odom_track_known @ keyframe.T_track_camera
    start = se3.inverse(anchor.T_odom_track) @ T_odom_camera
    # the finest level costs half of the time, and adds a digit that the anchor's own pose lacks
    refinement = refine(start, problem, COARSE_LEVELS)
    if not acceptance.is_conclusive(refinement):
        return None
    T_odom_seen = anchor.T_odom_track @ refinement.T_model_source
    correction = se3.log(T_odom_seen @ se3.inverse(T_odom_camera))
    in_odom = se3.transported_covariance(T_odom_track_known, keyframe.covariance)
    # drift that is less likely by the covariance is a place that looks like another
    if not mahalanobis_squared(correction, in_odom) <= POSE_GATE:
        return None
    return _Comparison(correction, revisit_edge(anchor, keyframe, refinement, errors))


def _agree(corrections: Float64) -> bool:
    """Whether there are several corrections [N, 6] that disagree by less than they correct."""
    if len(corrections) < 2:
        return False
    mean = corrections.mean(axis=0)
    scatter = np.sqrt(np.mean(np.sum((corrections - mean) ** 2, axis=1)))
    return bool(scatter < np.linalg.norm(mean))
