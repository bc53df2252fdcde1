"""Whether two keyframes show the same place, and their relative pose.

A candidate becomes a loop if RGBD-Glue finds a transform from the two images, or the graph predicts
one, the refinement from there is certain, and so is the refinement of the first on the second, at
the same pose. A similar place may pass one of these tests; two rooms never passed all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.pose_covariance import PoseErrors, refined_covariance
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.agreement import BandAgreement
from rgbd_glue_ros.refinement.gauss_newton import Refinement, refine
from rgbd_glue_ros.refinement.pose_residuals import rows_at
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraphEdge

# Maximum difference of the two refinements, metres plus radians: several times their errors.
_SAME = 0.05


def loop_edge(
    parent: MapKeyframe,
    child: MapKeyframe,
    glue: Glue,
    config: Config,
    T_parent_child_expected: Float64 | None = None,
) -> PoseGraphEdge | None:
    """The edge between two keyframes, or None if they do not certainly show the same place.

    Args:
        parent: the earlier one.
        child: the later one.
        glue: registers.
        config: how poses are refined, and when they are accepted.
        T_parent_child_expected: float64 [4, 4], from the graph; the search starts there if the
            images give no transform. None if nothing is known.
    """
    acceptance = Acceptance.of(config.odometry)
    result = glue.register(child.features, parent.features)
    T = result.T_target_source
    if T is None or len(result.visual_inliers) < acceptance.min_inliers:
        T = T_parent_child_expected
    if T is None:
        return None
    problem = RefinementProblem(parent.model, child.features.view, config.refine)
    refinement = _refined(T, problem, acceptance)
    if refinement is None:
        return None
    swapped = RefinementProblem(child.model, parent.features.view, config.refine)
    back = _refined(se3.inverse(refinement.T_model_source), swapped, acceptance)
    if back is None:
        return None
    T = refinement.T_model_source
    if se3.difference(T, se3.inverse(back.T_model_source)) > _SAME:
        return None
    # two that were taken far apart in time may disagree more than neighbours do
    agreement = BandAgreement().after_frame(rows_at(refinement, problem, level=0))
    errors = PoseErrors.of(config)
    count = agreement.residuals_per_independent_one(errors.residuals_per_independent_one)
    errors = replace(errors, residuals_per_independent_one=count)
    covariance = refined_covariance(refinement, np.eye(4), problem.view.twist, errors)
    return PoseGraphEdge(parent.row, child.row, T, covariance, EdgeOrigin.LOOP)


def T_map_odom_by(loop: PoseGraphEdge, T_map_parent: Float64, T_odom_child: Float64) -> Float64:
    """The pose of odom in a map according to a loop between them, float64 [4, 4].

    Args:
        loop: from a keyframe of the map to one of the odometry.
        T_map_parent: pose of the first in the map, float64 [4, 4].
        T_odom_child: pose of the second, float64 [4, 4].
    """
    T_map_child = T_map_parent @ loop.T_parent_child
    return np.asarray(T_map_child @ se3.inverse(T_odom_child), np.float64)


def _refined(T: Float64, problem: RefinementProblem, acceptance: Acceptance) -> Refinement | None:
    """The pose of one keyframe on the model of another, if planes and pixels are certain."""
    refinement = refine(T, problem)
    return refinement if acceptance.is_conclusive(refinement) else None
