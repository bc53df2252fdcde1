"""How much of the information about a pose is spurious, caused by errors of the derivatives.

Normals have errors: from noise, and where a plane was fitted across an edge. So have gradients of
the brightness. In the normal equations the squares of these errors add up instead of cancelling, so
that thousands of planes of one wall seem to hold a camera that can in fact slide along it. This is
the bias of least squares with errors in the variables. A second measurement of the variables
reveals it: how the residuals change when the pose moves, which depends on the images there and
hardly on the derivatives here. The regression of the second measurement on the first is the
reliability ratio (Fuller 1987, Measurement Error Models, 1.1): the fraction of the information that
is real.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.residual_rows import Rows, pixel_rows, plane_rows
from rgbd_glue_ros.types import Float64

# The cosine between two directions that noise alone may separate: 26 degrees.
_SAME_DIRECTION = 0.9
# Information in a direction that is less than this part of all is rounding.
_NOTHING = 1e-12


@dataclass(frozen=True)
class ExpectedPose:
    """The pose that is expected before refinement.

    Attributes:
        T_model_source: float64 [4, 4].
        covariance: float64 [6, 6], perturbation on the right.
    """

    T_model_source: Float64
    covariance: Float64


def without_spurious_information(
    refinement: Refinement,
    expected: ExpectedPose,
    problem: RefinementProblem,
    reach: float,
) -> Refinement:
    """Removes the spurious part of a pose's information in its weakest direction.

    If that is at least half of it, and the pose is farther than ``reach`` from where it was
    expected, nothing was measured in that direction: the pose is moved to where it was expected,
    and no information is left there.

    Args:
        refinement: the refined pose.
        expected: the pose that was expected before refinement.
        problem: the problem that it was refined with.
        reach: distance, metres and radians, over which residuals must change. A pose that is
            known more accurately than this is returned unchanged, and so is any if it is 0.
    """
    if reach == 0:
        return refinement
    T, information = refinement.T_model_source, _InformationInCamera.of(refinement)
    strength, weakest = information.weakest
    count = problem.config.residuals_per_independent_one
    # the variance of the pose in that direction is count / strength
    if strength * reach**2 > count or not strength > 0:
        return refinement
    direction = se3.adjoint(T) @ weakest
    finest, brightness = problem.at_level(0), refinement.affine_brightness
    both = (
        partial(plane_rows, problem=finest),
        partial(pixel_rows, problem=finest, affine_brightness=brightness),
    )
    spurious = sum(_spurious_information(rows_at, T, direction, reach) for rows_at in both)
    share = min(spurious / strength, 1.0)
    if share >= 1 / 2:
        there = expected_where_weakest(refinement, expected, reach)
        if se3.difference(T, there.T_model_source) > reach:
            return there
    least_known = information.direction_least_known(expected, reach)
    return replace(refinement, information=information.without(share, least_known))


def expected_where_weakest(
    refinement: Refinement, expected: ExpectedPose, reach: float
) -> Refinement:
    """A pose moved to where it was expected in its weakest direction, without information there.

    Args:
        refinement: the refined pose.
        expected: the pose that was expected before refinement.
        reach: as in ``without_spurious_information``.
    """
    T, information = refinement.T_model_source, _InformationInCamera.of(refinement)
    direction = information.direction_least_known(expected, reach)
    off = float(direction @ se3.log(se3.inverse(expected.T_model_source) @ T))
    return replace(
        refinement,
        T_model_source=T @ se3.exp(-off * direction),
        information=information.without(1.0, direction),
    )


@dataclass(frozen=True)
class _InformationInCamera:
    """The information of a pose about perturbations on its right.

    In the camera's frame a metre and a radian move the image by about as much, so that directions
    can be compared.

    Attributes:
        matrix: float64 [6, 6].
        T: the pose, float64 [4, 4].
    """

    matrix: Float64
    T: Float64

    @staticmethod
    def of(refinement: Refinement) -> _InformationInCamera:
        T = refinement.T_model_source
        A = se3.adjoint(T)
        return _InformationInCamera(A.T @ refinement.information @ A, T)

    @property
    def weakest(self) -> tuple[float, Float64]:
        """The least information, and its direction, float64 [6]."""
        strengths, directions = np.linalg.eigh(self.matrix)
        return float(strengths[0]), directions[:, 0]

    def direction_least_known(self, expected: ExpectedPose, reach: float) -> Float64:
        """The weakest direction, float64 [6], or the one in which the expected pose is uncertain.

        Noise tilts the weakest direction by a few degrees in every frame. If information is removed
        in another direction each time, what is left of it adds up to a measurement that nobody
        made, as in filters that linearise at a new estimate each time (Huang, Mourikis and
        Roumeliotis, Observability-based rules for designing consistent EKF SLAM estimators, 2010).
        So if the expected pose is already uncertain by more than ``reach`` in about the same
        direction, that one is taken.
        """
        weakest = self.weakest[1]
        variances, directions = np.linalg.eigh(expected.covariance)
        uncertain: Float64 = directions[:, -1]
        is_same = variances[-1] > reach**2 and abs(uncertain @ weakest) > _SAME_DIRECTION
        return uncertain if is_same else weakest

    def without(self, share: float, direction: Float64) -> Float64:
        """The information [6, 6], perturbation on the left, less a share of that in a direction.

        All other directions keep what is known of them wherever the pose is along this one.
        """
        along = self.matrix @ direction
        known = float(direction @ along)
        left = self.matrix
        if known > _NOTHING * np.trace(self.matrix):
            left = left - share * np.outer(along, along) / known
        to_camera = se3.adjoint(se3.inverse(self.T))
        information: Float64 = to_camera.T @ left @ to_camera
        return information


def _spurious_information(
    rows_at: Callable[[Float64], Rows], T: Float64, direction: Float64, reach: float
) -> float:
    """The information of planes or pixels in a direction, times one minus the reliability ratio."""
    rows = rows_at(T)
    derivative = rows.jacobian @ direction
    ahead, behind = (
        _residuals(rows_at(se3.exp(step * direction) @ T), rows) for step in (reach, -reach)
    )
    change = (ahead - behind) / (2 * reach)
    known = np.isfinite(change)
    weighted = rows.weight[known] * derivative[known]
    expected, changed = float(weighted @ derivative[known]), float(weighted @ change[known])
    reliability = min(max(changed / max(expected, np.finfo(float).tiny), 0.0), 1.0)
    return (1 - reliability) * float(rows.weight @ derivative**2)


def _residuals(moved: Rows, rows: Rows) -> Float64:
    """The residuals of the same points at another pose; NaN for those that are not seen there."""
    size = 1 + max(moved.point.max(initial=0), rows.point.max(initial=0))
    residuals = np.full(size, np.nan)
    residuals[moved.point] = moved.residual
    return residuals[rows.point]
