"""How much of the information about a pose is spurious, caused by errors of the derivatives.

Normals have errors: from noise, and where a plane was fitted across an edge. So have gradients of
the brightness. In the normal equations the squares of these errors add up instead of cancelling, so
that thousands of planes of one wall seem to hold a camera that can in fact slide along it. This is
the bias of least squares with errors in the variables.

A second measurement of the derivatives, with errors of its own (``second_derivatives.py``), reveals
it. With weights w, derivatives j and second ones c, each [6], the apparent information is
A = Σ w j jᵀ, and that which both measurements have in common is R = Σ w j cᵀ: errors do not add up
in it. The reliability ratio of a direction x is xᵀRx / xᵀAx (Fuller 1987, Measurement Error Models,
1.1), the fraction of its information that is real. It is 1 where images determine a pose, and 0
where they do not. So the directions that were not measured, three in front of a bare wall and one
along a corridor, are the generalised eigenvectors, R x = ratio A x, with a small ratio and little
in common: in the dark most of the gradients is noise, and the rest may be enough. The weakest
directions, eigenvectors of A, are others: errors tilt them towards what was measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.second_derivatives import real_and_apparent_information
from rgbd_glue_ros.types import Float64

SAME_DIRECTION = 0.99
"""The cosine between two directions that noise alone may separate: 8 degrees.

With more, directions that are measured take part in the uncertainty of others, and poses oscillate
after seconds.
"""
# With a smaller reliability ratio information is spurious. The ratio of noise, and of the steps of
# slanted edges, is up to 0.2; that of texture as fine as pixels, which a smaller image shows less
# of, is 0.45 or more.
_LEAST_REAL = 1 / 3
# In all directions of more than this many times the information that is needed, some is real: edges
# of black and white surfaces make up 8 times as much.
_AMPLE = 20.0
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
    tolerance: float,
) -> Refinement:
    """Removes the information about a pose in directions in which it is spurious.

    Nothing was measured there: if the pose is farther than ``tolerance`` from where it was
    expected along these directions, it is moved there.

    Args:
        refinement: the refined pose.
        expected: the pose that was expected before refinement.
        problem: the problem that it was refined with.
        tolerance: distance, metres and radians. A pose that is known much more accurately than this
            in all directions is returned unchanged, and so is any if it is 0.
    """
    measured = _Measured.of(refinement, expected, problem, tolerance)
    there = measured.as_expected(expected)
    is_far = se3.difference(refinement.T_model_source, there.T_model_source) > tolerance
    return there if is_far else measured.refinement


def expected_where_unmeasured(
    refinement: Refinement,
    expected: ExpectedPose,
    problem: RefinementProblem,
    tolerance: float,
) -> Refinement:
    """The same, with the pose where it was expected however near that is."""
    return _Measured.of(refinement, expected, problem, tolerance).as_expected(expected)


@dataclass(frozen=True)
class _Measured:
    """What was measured of a pose.

    Attributes:
        refinement: the pose, with the information that was.
        not_along: float64 [6, M], orthonormal directions of perturbations on the right in which
            nothing was.
    """

    refinement: Refinement
    not_along: Float64

    @staticmethod
    def of(
        refinement: Refinement, expected: ExpectedPose, problem: RefinementProblem, tolerance: float
    ) -> _Measured:
        """Arguments as of ``without_spurious_information``."""
        T, nowhere = refinement.T_model_source, np.empty((6, 0))
        if tolerance == 0:
            return _Measured(refinement, nowhere)
        # in the camera's frame a metre and a radian move the image by about as much, so that
        # directions can be compared
        to_model, to_camera = se3.adjoint(T), se3.adjoint(se3.inverse(T))
        information = to_model.T @ refinement.information @ to_model
        # of a direction in which the standard deviation of the pose is the tolerance
        enough = problem.config.residuals_per_independent_one / tolerance**2
        if not 0 < np.linalg.eigvalsh(information)[0] < _AMPLE * enough:
            return _Measured(refinement, nowhere)
        both = real_and_apparent_information(T, problem, refinement.affine_brightness)
        real, apparent = (to_model.T @ m @ to_model for m in both)
        ratio, x = _generalised_eigenvectors(real, apparent)
        x /= np.linalg.norm(x, axis=0)
        # what could not be compared counts as real
        known = np.einsum("ik,ij,jk->k", x, information - apparent + real, x)
        unmeasured = x[:, (ratio < _LEAST_REAL) & (known < enough)]
        if unmeasured.shape[1] == 0:
            return _Measured(refinement, nowhere)
        unmeasured = _as_uncertain(unmeasured, expected.covariance, tolerance)
        measured = to_camera.T @ _without(information, unmeasured) @ to_camera
        return _Measured(replace(refinement, information=measured), unmeasured)

    def as_expected(self, expected: ExpectedPose) -> Refinement:
        """The pose moved to where it was expected in directions in which nothing was measured."""
        T, U = self.refinement.T_model_source, self.not_along
        off = U @ (U.T @ se3.log(se3.inverse(expected.T_model_source) @ T))
        return replace(self.refinement, T_model_source=T @ se3.exp(-off))


def _generalised_eigenvectors(R: Float64, A: Float64) -> tuple[Float64, Float64]:
    """Ratios [6] and vectors x [6, 6], the columns, with R x = ratio A x and xᵀ A x = 1.

    The ratio is 1 where A is 0: nothing is known to be spurious.
    """
    nothing = (_NOTHING * np.trace(A) + np.finfo(float).tiny) * np.eye(len(A))
    L = np.linalg.cholesky(A + nothing)
    half = np.linalg.solve(L, R + nothing)
    ratio, y = np.linalg.eigh(np.linalg.solve(L, half.T))
    return ratio, np.asarray(np.linalg.solve(L.T, y), np.float64)


def _as_uncertain(unmeasured: Float64, covariance: Float64, tolerance: float) -> Float64:
    """Directions [6, M], orthonormal, in place of others by which they nearly are spanned.

    Noise tilts unmeasured directions by a few degrees in every frame. If information is removed in
    others each time, what is left of it adds up to a measurement that nobody made, as in filters
    that linearise at a new estimate each time (Huang, Mourikis and Roumeliotis, Observability-based
    rules for designing consistent EKF SLAM estimators, 2010). So directions in which the expected
    pose is already uncertain by more than ``tolerance`` are taken first.

    Args:
        unmeasured: float64 [6, M], of any length.
        covariance: of the expected pose, float64 [6, 6].
        tolerance: metres and radians.
    """
    U = np.linalg.qr(unmeasured)[0]
    variances, directions = np.linalg.eigh(covariance)
    uncertain = directions[:, variances > tolerance**2][:, ::-1]
    D = uncertain[:, np.linalg.norm(U.T @ uncertain, axis=0) > SAME_DIRECTION][:, : U.shape[1]]
    # the part of U across D: as many directions as D has not replaced
    across = np.linalg.svd(U - D @ (D.T @ U))[0][:, : U.shape[1] - D.shape[1]]
    return np.column_stack([D, across])


def _without(information: Float64, U: Float64) -> Float64:
    """Information [6, 6] less all of that along U [6, M].

    All other directions keep what is known of them wherever the pose is along these.
    """
    along = information @ U
    known = U.T @ along
    strengths, directions = np.linalg.eigh(known)
    kept = strengths > _NOTHING * np.trace(information)
    W = along @ directions[:, kept] / np.sqrt(strengths[kept])
    return np.asarray(information - W @ W.T, np.float64)
