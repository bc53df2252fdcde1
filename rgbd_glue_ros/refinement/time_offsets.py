"""The true times of a camera's images, estimated while it moves.

Drivers stamp depth later than colour of the same moment, and rolling shutters read the rows of an
image one after the other. When the camera moves, both cause a disagreement between planes and
pixels that no pose explains. So the two times are estimated along with the poses, as in the online
calibration of time offsets (Li and Mourikis 2014, Qin and Shen 2018): with the pose eliminated, the
residuals of each frame update a Kalman filter of two slowly drifting constants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.parameters import TimeOffsetsConfig
from rgbd_glue_ros.refinement.normal_equations import (
    extended_normal_equations,
    marginalise_pose,
)
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.residual_rows import Rows
from rgbd_glue_ros.types import Float64

# Limit of both: no driver is later, and no camera of a moving robot reads out more slowly.
_LIMIT_S = 0.05

PRIMESENSE_FRAMES = "openni"
"""Prefix of the camera frame's name in OpenNI's drivers, and in recordings made with them."""

# Kinect v1 and Xtion: planes and pixels of one of each agree best with a latency of 15 to 20 ms and
# a readout time of 26 ms.
_PRIMESENSE_LATENCY_S, _PRIMESENSE_READOUT_TIME_S = 0.017, 0.026


@dataclass(frozen=True)
class TimeOffsets:
    """When a camera takes its images, as estimated.

    Attributes:
        depth_latency: how much later depth is stamped than colour of the same moment, seconds.
        readout_time: time from the first row of an image to the last, seconds; 0 for a global
            shutter, negative if the last row is read first.
        covariance: float64 [2, 2], covariance of both, s².
    """

    depth_latency: float
    readout_time: float
    covariance: Float64

    @staticmethod
    def start(config: TimeOffsetsConfig, frame_id: str) -> TimeOffsets:
        """The time offsets before the first frame of a camera with this optical frame.

        A spread of 0 in the configuration means that the user has calibrated them; then they are
        used as they are.
        """
        if config.spread > 0 and frame_id.startswith(PRIMESENSE_FRAMES):
            return TimeOffsets(_PRIMESENSE_LATENCY_S, _PRIMESENSE_READOUT_TIME_S, np.zeros((2, 2)))
        return TimeOffsets(config.depth_latency, config.readout_time, np.eye(2) * config.spread**2)

    @property
    def is_settled(self) -> bool:
        """Whether they are known and need not be estimated."""
        return not self.covariance.any()

    @property
    def readout_ratio(self) -> float:
        """The longest plausible readout time of an image, as a multiple of a Kinect's."""
        longest = abs(self.readout_time) + float(np.sqrt(self.covariance[1, 1]))
        return longest / _PRIMESENSE_READOUT_TIME_S

    def corrected(
        self,
        rows: tuple[Rows, Rows],
        T_model_source: Float64,
        problem: RefinementProblem,
        config: TimeOffsetsConfig,
    ) -> TimeOffsets:
        """The time offsets after a frame.

        Args:
            rows: residuals of planes and pixels at the frame's pose, at the finest level.
            T_model_source: that pose, float64 [4, 4].
            problem: the problem that it was refined with; its view has the frame's velocity.
            config: how fast they drift.
        """
        H, g = marginalise_pose(*_terms(rows, T_model_source, problem))
        information = H / config.residuals_per_independent_one
        gradient = g / config.residuals_per_independent_one
        predicted = self.covariance + np.eye(2) * config.drift**2
        covariance = np.asarray(np.linalg.inv(np.linalg.inv(predicted) + information), np.float64)
        offsets = np.array([self.depth_latency, self.readout_time]) - covariance @ gradient
        if not (np.isfinite(offsets).all() and np.isfinite(covariance).all()):
            return self  # otherwise all later frames would inherit it
        latency, readout_time = np.clip(offsets, -_LIMIT_S, _LIMIT_S)
        return TimeOffsets(float(latency), float(readout_time), covariance)


def _terms(
    rows: tuple[Rows, Rows], T: Float64, problem: RefinementProblem
) -> tuple[Float64, Float64]:
    """Hessian [8, 8] and gradient [8] for the pose, depth latency and readout time."""
    twist, planes, pixels = problem.view.twist, problem.model.planes, problem.model.pixels[0]
    plane_rows, pixel_rows = rows
    by_now, by_then, by_readout_time = _derivatives_by_time(
        plane_rows, T, twist, planes.velocity, planes.row_time
    )
    H, g = extended_normal_equations(plane_rows, by_then - by_now, by_readout_time)
    *_, by_readout_time = _derivatives_by_time(
        pixel_rows, T, twist, pixels.velocity, pixels.row_time
    )
    # late depth is shifted along the surface, and so hardly changes the depth of a pixel
    by_latency = np.zeros_like(by_readout_time)
    H_pixels, g_pixels = extended_normal_equations(pixel_rows, by_latency, by_readout_time)
    return H + H_pixels, g + g_pixels


def _derivatives_by_time(
    rows: Rows, T: Float64, twist: Float64, velocity: Float64, row_time: Float64
) -> tuple[Float64, Float64, Float64]:
    """Derivatives [N] of residuals by two moments, and by readout time, per second.

    Args:
        rows: residuals of N points of a model.
        T: pose of the frame in the model, float64 [4, 4].
        twist: float64 [6] of the camera at the frame.
        velocity: float64 [M, 3], the model's ``ModelPoints.velocity``.
        row_time: float64 [M], the model's ``ModelPoints.row_time``.

    Returns:
        By the time of the frame, by that at which the model's points were seen, and by readout
        time, which shifts both.
    """
    by_now = np.sum(rows.jacobian * (se3.adjoint(T) @ twist), axis=1)
    by_then = np.sum(rows.jacobian[:, :3] * velocity[rows.point], axis=1)
    return by_now, by_then, rows.row_time * by_now - row_time[rows.point] * by_then
