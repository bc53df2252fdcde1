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

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.residual_rows import Rows, pixel_rows, plane_rows
from rgbd_glue_ros.types import Float64


def without_spurious_information(
    refinement: Refinement,
    T_expected: Float64,
    problem: RefinementProblem,
    reach: float,
) -> Refinement:
    """Removes the spurious part of a pose's information in its weakest direction.

    If that is at least half of it, and the pose is farther than ``reach`` from where it was
    expected, nothing was measured in that direction: the pose is moved to where it was expected,
    and no information is left there.

    Args:
        refinement: the refined pose.
        T_expected: the pose that was expected before refinement, float64 [4, 4].
        problem: the problem that it was refined with.
        reach: distance, metres and radians, over which residuals must change. A pose that is
            known more accurately than this is returned unchanged, and so is any if it is 0.
    """
    if reach == 0:
        return refinement
    T, directions = refinement.T_model_source, _InformationInCamera.of(refinement)
    strength, weakest = directions.eigenvalues[0], directions.weakest
    as_one = problem.config.residuals_per_independent_one
    if strength * reach**2 > as_one or not strength > 0:
        return refinement
    finest, brightness = problem.at_level(0), refinement.affine_brightness
    spurious = _spurious_information(
        lambda moved: plane_rows(moved, finest), T, weakest, reach
    ) + _spurious_information(
        lambda moved: pixel_rows(moved, finest, brightness), T, weakest, reach
    )
    share = min(spurious / strength, 1.0)
    expected = expected_in_weakest_direction(refinement, T_expected)
    if share >= 1 / 2 and se3.difference(T, expected.T_model_source) > reach:
        return expected
    return replace(refinement, information=directions.with_weakest_times(1 - share))


def expected_in_weakest_direction(refinement: Refinement, T_expected: Float64) -> Refinement:
    """A pose moved to where it was expected in its weakest direction, without information there.

    Args:
        refinement: the refined pose.
        T_expected: the pose that was expected before refinement, float64 [4, 4].
    """
    T, directions = refinement.T_model_source, _InformationInCamera.of(refinement)
    off = float(directions.along_weakest(se3.log(T @ se3.inverse(T_expected))))
    return replace(
        refinement,
        T_model_source=se3.exp(-off * directions.weakest) @ T,
        information=directions.with_weakest_times(0.0),
    )


@dataclass(frozen=True)
class _InformationInCamera:
    """The information of a pose by directions, weakest first.

    Directions are orthogonal in the camera's frame, where a metre and a radian move the image by
    about as much.

    Attributes:
        eigenvalues: float64 [6].
        directions: float64 [6, 6], one a column, perturbations on the right of the pose.
        T: the pose, float64 [4, 4].
    """

    eigenvalues: Float64
    directions: Float64
    T: Float64

    @staticmethod
    def of(refinement: Refinement) -> _InformationInCamera:
        T = refinement.T_model_source
        A = se3.adjoint(T)
        return _InformationInCamera(*np.linalg.eigh(A.T @ refinement.information @ A), T)

    @property
    def weakest(self) -> Float64:
        """The weakest direction, float64 [6], a perturbation on the left of the pose."""
        direction: Float64 = se3.adjoint(self.T) @ self.directions[:, 0]
        return direction

    def along_weakest(self, twist: Float64) -> Float64:
        """The component of a twist [6], a perturbation on the left, in the weakest direction."""
        component: Float64 = self.directions[:, 0] @ se3.adjoint(se3.inverse(self.T)) @ twist
        return component

    def with_weakest_times(self, factor: float) -> Float64:
        """The information [6, 6], perturbation on the left, with less in the weakest direction."""
        eigenvalues, to_camera = self.eigenvalues.copy(), se3.adjoint(se3.inverse(self.T))
        eigenvalues[0] *= factor
        information: Float64 = (
            to_camera.T @ (self.directions * eigenvalues) @ self.directions.T @ to_camera
        )
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
