"""The derivatives of residuals at a pose, each measured twice.

Those that poses are refined with have errors: normals, which are of a keyframe, those of its depth,
and gradients those of the frame's brightness. A second measurement has errors of its own, or hardly
any: a normal of the frame's depth, and a gradient of a smaller image, in which noise and the steps
of slanted edges are averaged. What is real of derivatives is what the two have in common
(``reliability.py``).

A residual changes with the position of its point, and a perturbation v, omega of the pose moves a
point X by v + omega x X. So its derivative by omega is X x that by v.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry.normals import normals_of_nine
from rgbd_glue_ros.refinement.level_problem import LevelProblem
from rgbd_glue_ros.refinement.match_residuals import match_information
from rgbd_glue_ros.refinement.normal_equations import mirror_upper_triangle
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.projection import project
from rgbd_glue_ros.refinement.residuals import (
    PlaneFit,
    by_rotation,
    pixel_residuals,
    plane_residuals,
    weight_of_pixels,
)
from rgbd_glue_ros.types import Float64

# An edge is about as many pixels wide in the next smaller image, so that it is half as steep there,
# per metre. Of the noise of a gradient, a tenth of the square is in both.
_STEEPER = 2.0


def real_and_apparent_information(
    T: Float64, problem: RefinementProblem, affine_brightness: Float64
) -> tuple[Float64, Float64]:
    """What both measurements of the derivatives have in common, and what the first alone says.

    Residuals that have only one are left out, but matches count as real.

    Args:
        T: T_model_camera, float64 [4, 4].
        problem: the model and the frame.
        affine_brightness: as in ``Refinement``.

    Returns:
        The information of both, float64 [6, 6] each, perturbation on the left of T.
    """
    finest, smaller = problem.at_level(0), problem.at_level(1)
    # every second plane: two thousand tell a ratio to a twentieth
    of_planes, planes = _planes_derived_twice(T, smaller)
    of_planes = of_planes._replace(weight=2 * of_planes.weight)
    in_smaller = smaller._replace(pixels=finest.pixels, brightness=finest.brightness)
    of_pixels = _pixels_derived_twice(T, finest, in_smaller, affine_brightness, planes)
    R_planes, A_planes = _information(of_planes)
    R_pixels, A_pixels = _information(of_pixels)
    of_matches = match_information(T, finest)
    return R_planes + R_pixels + of_matches, A_planes + A_pixels + of_matches


class _TwiceDerived(NamedTuple):
    """Residuals whose derivatives are known twice, for a perturbation on the left of a pose.

    Attributes:
        weight: float64 [N]; 0 for a residual without one of the two, whose other values mean
            nothing.
        first: float64 [6, N], as used in a refinement.
        second: float64 [6, N].
    """

    weight: Float64
    first: Float64
    second: Float64


@compiled
def _planes_derived_twice(T: Float64, problem: LevelProblem) -> tuple[_TwiceDerived, PlaneFit]:
    """Those of planes, by the normals of keyframes and of the frame; and how the planes fit.

    A plane is left out where the frame's depth has no normal, as beside an edge.
    """
    residuals, _, planes = plane_residuals(T, problem)
    shown = np.flatnonzero(residuals.weight)
    points = np.ascontiguousarray(problem.points[:, shown])
    seen = project(T, points, problem.depth_exposure)
    rows, columns = (seen.v + 0.5).astype(np.int64), (seen.u + 0.5).astype(np.int64)
    K, noise = problem.depth_exposure.K, problem.depth_noise
    normals = np.dot(T[:3, :3].copy(), normals_of_nine(problem.depth, K, rows, columns, noise))
    weight, second = residuals.weight[shown], np.empty((6, len(shown)))
    for i in range(len(shown)):
        x, y, z = points[0, i], points[1, i], points[2, i]
        n0, n1, n2 = normals[0, i], normals[1, i], normals[2, i]
        weight[i] = 0.0 if np.isnan(n0) else weight[i]
        second[0, i], second[1, i], second[2, i] = n0, n1, n2
        second[3, i], second[4, i], second[5, i] = by_rotation(x, y, z, n0, n1, n2)
    first = np.ascontiguousarray(residuals.jacobian[:, shown])
    return _TwiceDerived(weight, first, second), planes


@compiled
def _pixels_derived_twice(
    T: Float64,
    problem: LevelProblem,
    in_smaller: LevelProblem,
    affine_brightness: Float64,
    planes: PlaneFit,
) -> _TwiceDerived:
    """Those of pixels, by the gradients of the frame's image and of the next smaller one.

    Args:
        T: T_model_camera, float64 [4, 4].
        problem: with the frame's image.
        in_smaller: the same pixels, with the smaller image.
        affine_brightness: as in ``Refinement``.
        planes: how planes fit, which the weight of pixels depends on.
    """
    residuals, _ = pixel_residuals(T, problem, affine_brightness)
    again, _ = pixel_residuals(T, in_smaller, affine_brightness)
    scale = weight_of_pixels(problem, planes) / affine_brightness[2] ** 2
    # the border of the smaller image is wider
    weight = np.where(again.weight > 0.0, scale * residuals.weight, 0.0)
    return _TwiceDerived(weight, residuals.jacobian, _STEEPER * again.jacobian)


@compiled
def _information(residuals: _TwiceDerived) -> tuple[Float64, Float64]:
    """Real and apparent information [6, 6] of some residuals: Σ w j cᵀ, symmetric, and Σ w j jᵀ."""
    weight, first, second = residuals.weight, residuals.first, residuals.second
    real, apparent = np.zeros((6, 6)), np.zeros((6, 6))
    for i in range(len(weight)):
        if weight[i] == 0.0:
            continue
        for a in range(6):
            first_a, second_a = weight[i] * first[a, i], weight[i] * second[a, i]
            for b in range(a, 6):
                apparent[a, b] += first_a * first[b, i]
                real[a, b] += 0.5 * (first_a * second[b, i] + second_a * first[b, i])
    mirror_upper_triangle(apparent)
    mirror_upper_triangle(real)
    return real, apparent
