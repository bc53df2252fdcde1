"""Another pose of a frame, on which the part that contradicts the accepted one agrees.

Robust residuals ignore what does not fit. If that is consistent with another motion of the camera,
one of the two motions is that of a moving object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.plane_counts import PlaneCounts
from rgbd_glue_ros.odometry.pose_refinement import COARSE_LEVELS, PoseProblem
from rgbd_glue_ros.refinement.gauss_newton import Refinement, refine_at
from rgbd_glue_ros.refinement.level_problem import LevelProblem
from rgbd_glue_ros.refinement.residuals import (
    AGREEING_SIGMAS,
    pixel_residuals,
    visible_planes,
)
from rgbd_glue_ros.types import Float64, Mask

# An alternative adds its share times its squared distance to the covariance of a pose. With this
# share it is three standard deviations away; with less it is farther, and not searched for.
_SUBSTANTIAL = 1 / 9


@dataclass(frozen=True)
class Alternative:
    """Another pose of a frame, with which a part of its view agrees.

    Attributes:
        T_track_camera: float64 [4, 4].
        share: of the surface that agrees with only one of the two poses, the fraction that agrees
            with this one; from 0 to 1.
    """

    T_track_camera: Float64
    share: float

    @property
    def is_larger(self) -> bool:
        """Whether more of the surface agrees with it than with the pose that it contradicts."""
        return self.share > 1 / 2


def is_contradicted(pose: Refinement) -> bool:
    """Whether a substantial part of a frame's planes disagrees with a pose."""
    return 1 - pose.plane_agreement >= _SUBSTANTIAL


def find_alternative(
    problem: PoseProblem, pose: Refinement, before: Alternative | None, acceptance: Acceptance
) -> Alternative | None:
    """The other pose on which a part of the frame agrees, and which contradicts the accepted one.

    Args:
        problem: the frame, and the inputs of its refinement.
        pose: the accepted pose, at the coarse levels.
        before: the alternative of the previous frame: a moving object has not moved far since.
        acceptance: the evidence that a pose needs.

    Returns:
        None if little contradicts, the contradicting parts disagree, or noise may explain them.
    """
    if not is_contradicted(pose):
        return None
    images_alone = problem.without_matches()
    levels = [(level, images_alone.at_level(level)) for level in COARSE_LEVELS]
    rest = [(level, _contradicting(of_level, pose)) for level, of_level in levels]
    predicted = problem.predicted.T_track_camera
    starts = [pose.T_model_source]
    if not problem.basin.connects(predicted, pose.T_model_source):
        starts.append(predicted)
    if before is not None:
        starts.append(before.T_track_camera)
    best = None
    for start in starts:
        T = _coherent(rest, start, pose, problem.config.iterations, acceptance)
        if T is None or problem.basin.connects(T, pose.T_model_source):
            continue
        _, finest = levels[-1]
        if not PlaneCounts.of(T, pose.T_model_source, finest).are_for_first:
            continue
        share = _share(finest, T, pose.T_model_source)
        if share >= _SUBSTANTIAL and (best is None or share > best.share):
            best = Alternative(T, share)
    return best


def agreeing_planes(of_level: LevelProblem, T: Float64) -> Mask:
    """Which planes agree with a pose."""
    return visible_planes(T, of_level)[1]


def agreeing_pixels(of_level: LevelProblem, T: Float64, affine_brightness: Float64) -> Mask:
    """Which pixels agree with a pose."""
    residuals, _ = pixel_residuals(T, of_level, affine_brightness)
    limit = AGREEING_SIGMAS * affine_brightness[2]
    agrees: Mask = (residuals.weight > 0) & (np.abs(residuals.residual) < limit)
    return agrees


def _coherent(
    rest: Sequence[tuple[int, LevelProblem]],
    start: Float64,
    pose: Refinement,
    iterations: int,
    acceptance: Acceptance,
) -> Float64 | None:
    """The pose on which the part that contradicts another one agrees; None if it does not agree.

    Part of any noise agrees with some pose. So more has to agree here than with a pose supported by
    the whole view: only half as much may disagree.

    Args:
        rest: each level, coarse to fine, and the contradicting part there.
        start: of the search, float64 [4, 4].
        pose: the contradicted pose.
        iterations: maximum at each level.
        acceptance: the evidence that a pose needs.
    """
    T, refined = start, pose
    for level, of_the_rest in rest:
        refined = refine_at(T, of_the_rest, pose.affine_brightness, iterations)
        T = refined.T_model_source
        # a level has every 2^level-th plane
        if refined.planes_agreeing * 2**level < acceptance.min_planes:
            return None
        if refined.visible_agreement < acceptance.plane_agreement:
            return None
    if refined.visible_agreement < acceptance.clear_agreement:
        return None
    is_blank = refined.pixels_seen < acceptance.min_pixels
    return T if is_blank or acceptance.correlates(refined) else None


def _share(of_level: LevelProblem, T: Float64, T_other: Float64) -> float:
    """The fraction that agrees with T, of the surface that agrees with only one of two poses."""
    agrees, agrees_with_other = (agreeing_planes(of_level, pose) for pose in (T, T_other))
    # the surface behind a pixel grows with the square of its depth
    area = se3.transform(se3.inverse(T), of_level.points.T)[:, 2] ** 2
    alone = float(area[agrees & ~agrees_with_other].sum())
    other_alone = float(area[agrees_with_other & ~agrees].sum())
    return alone / max(alone + other_alone, np.finfo(float).tiny)


def _contradicting(of_level: LevelProblem, pose: Refinement) -> LevelProblem:
    """The problem of the planes and pixels that do not agree with a pose."""
    planes = ~agreeing_planes(of_level, pose.T_model_source)
    pixels = ~agreeing_pixels(of_level, pose.T_model_source, pose.affine_brightness)
    return of_level._replace(
        points=of_level.points.compress(planes, axis=1),
        normals=of_level.normals.compress(planes, axis=1),
        pixels=of_level.pixels.compress(pixels, axis=1),
        brightness=of_level.brightness[pixels],
    )
