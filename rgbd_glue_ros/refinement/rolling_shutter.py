"""The camera's velocity, from the distortion of a single frame.

A moving camera reads each row of a rolling shutter at another place, and takes late depth at
another place than colour. Velocity from the difference of two poses has the jitter of both, and
shows a change of speed late; the distortion shows the velocity at the frame itself. As in
visual odometry for rolling shutters (Hedborg et al. 2012, Kim, Cadena and Reid 2016), it is
estimated together with the pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.refinement.normal_equations import (
    damped,
    extended_normal_equations,
    marginalise_pose,
)
from rgbd_glue_ros.refinement.pose_residuals import rows_at
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.residual_rows import Rows
from rgbd_glue_ros.types import Float64

# Standard deviation of a velocity that causes no distortion, m/s and rad/s: above any camera's.
_UNSEEN_SPEED = 100.0


@dataclass(frozen=True)
class Distortion:
    """How a refined pose depends on the velocity that its frame was refined with.

    Residuals see the camera at other times than that of the pose, and what they hold is the pose
    moved by the velocity until then. With a velocity that is wrong by e, the pose is wrong by
    -seconds e, a perturbation on the right.

    Attributes:
        twist: float64 [6], the velocity that it was refined with (m/s, rad/s; camera's frame).
        seconds: float64 [6, 6], the mean of these times, weighted by information.
    """

    twist: Float64
    seconds: Float64


@dataclass(frozen=True)
class TwistMeasurement:
    """The velocity of a camera, measured from one frame.

    Attributes:
        twist: float64 [6], linear and angular in the camera's frame (m/s, rad/s).
        covariance: float64 [6, 6], its covariance; large if nothing is distorted.
    """

    twist: Float64
    covariance: Float64


def distortion_at(refinement: Refinement, problem: RefinementProblem, level: int) -> Distortion:
    """How a pose depends on the twist of its frame; arguments as of ``twist_from_distortion``."""
    H, _ = _normal_equations(refinement, problem, level)
    return _distortion(H, problem)


def twist_from_distortion(
    refinement: Refinement, problem: RefinementProblem, level: int
) -> tuple[TwistMeasurement, Distortion]:
    """The velocity of the camera during a frame, with the pose eliminated, and what it does to it.

    Args:
        refinement: the frame's pose in the model.
        problem: the problem that it was refined with; the twist of its view is the start.
        level: pyramid level.
    """
    H, g = _normal_equations(refinement, problem, level)
    distortion = _distortion(H, problem)
    H, g = marginalise_pose(H, g)
    count = problem.config.residuals_per_independent_one
    covariance = np.asarray(np.linalg.inv(H / count + np.eye(6) / _UNSEEN_SPEED**2), np.float64)
    twist = problem.view.twist - covariance @ (g / count)
    return TwistMeasurement(twist, covariance), distortion


def _distortion(H: Float64, problem: RefinementProblem) -> Distortion:
    return Distortion(problem.view.twist, np.linalg.inv(damped(H[:6, :6])) @ H[:6, 6:])


def _normal_equations(
    refinement: Refinement, problem: RefinementProblem, level: int
) -> tuple[Float64, Float64]:
    """Hessian [12, 12] and gradient [12] for pose and velocity, both in the camera's frame."""
    source = problem.view
    planes, pixels = rows_at(refinement, problem, level)
    H, g = _pose_and_twist(planes, source.depth_delay + planes.row_time * source.readout_time)
    H_pixels, g_pixels = _pose_and_twist(pixels, pixels.row_time * source.readout_time)
    to_model = np.kron(np.eye(2), se3.adjoint(refinement.T_model_source))
    return to_model.T @ (H + H_pixels) @ to_model, to_model.T @ (g + g_pixels)


def _pose_and_twist(rows: Rows, seconds: Float64) -> tuple[Float64, Float64]:
    """Hessian [12, 12] and gradient [12] for the pose and the velocity, both in the model's frame.

    Args:
        rows: residuals.
        seconds: float64 [N], time from the pose to the moment that each residual was seen at,
            during which the velocity has moved the camera.
    """
    return extended_normal_equations(rows, rows.jacobian * seconds[:, np.newaxis])
