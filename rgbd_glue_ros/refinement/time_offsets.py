"""When a camera's images are really taken, found out while it moves.

Drivers stamp depth later than colour of the same moment, and rolling shutters read the rows of an
image one after the other. Where the camera moves, both show as disagreement between planes and
pixels that no pose explains. So the two times are estimated along with the poses, as an online
calibration of time offsets does (Li and Mourikis 2014, Qin and Shen 2018): every frame adds the
information that its residuals hold beyond the pose to a Kalman filter of two constants that drift.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.parameters import TimeOffsetsConfig
from rgbd_glue_ros.refinement.gauss_newton import Refinement, marginalise_pose
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.residual_rows import (
    Rows,
    extended_normal_equations,
    pixel_rows,
    plane_rows,
)
from rgbd_glue_ros.types import Float64

# No driver is later, and no camera of a moving robot reads slower.
_LIMIT_S = 0.05

PRIMESENSE_FRAMES = "openni"
"""How OpenNI's drivers, and what was recorded with them, begin the name of the camera's frame."""

# Kinect v1 and Xtion: planes and pixels of one of each agree best with 15 to 20 ms and 26 ms.
_PRIMESENSE_LATENCY_S, _PRIMESENSE_READOUT_TIME_S = 0.017, 0.026


@dataclass(frozen=True)
class TimeOffsets:
    """What is known of a camera's timing.

    Attributes:
        depth_latency: how much later depth is stamped than colour of the same moment, seconds.
        readout_time: from the first row of an image to the last, seconds; 0 for a global shutter,
            negative where the last row is read first.
        covariance: float64 [2, 2] of both, s².
    """

    depth_latency: float
    readout_time: float
    covariance: Float64

    @staticmethod
    def start(config: TimeOffsetsConfig, frame_id: str) -> TimeOffsets:
        """What is known before the first frame, whose camera has the frame ``frame_id``.

        A spread of 0 in the configuration is somebody's own calibration, and is left alone.
        """
        if config.spread > 0 and frame_id.startswith(PRIMESENSE_FRAMES):
            return TimeOffsets(_PRIMESENSE_LATENCY_S, _PRIMESENSE_READOUT_TIME_S, np.zeros((2, 2)))
        return TimeOffsets(config.depth_latency, config.readout_time, np.eye(2) * config.spread**2)

    @property
    def settled(self) -> bool:
        """Whether it is known, so that images have nothing to add."""
        return not self.covariance.any()

    @property
    def readout_share(self) -> float:
        """How long an image may take to be read, as a part of what a Kinect's takes."""
        longest = abs(self.readout_time) + float(np.sqrt(self.covariance[1, 1]))
        return longest / _PRIMESENSE_READOUT_TIME_S

    def corrected(
        self, refinement: Refinement, problem: RefinementProblem, config: TimeOffsetsConfig
    ) -> TimeOffsets:
        """The timing after a frame.

        Args:
            refinement: the frame's pose in the model.
            problem: what it was refined by; its view has the velocity that it had.
            config: how fast the timing drifts.
        """
        H, g = marginalise_pose(*_terms(refinement, problem))
        information, gradient = (
            H / config.residuals_per_independent_one,
            g / config.residuals_per_independent_one,
        )
        predicted = self.covariance + np.eye(2) * config.drift**2
        covariance = np.asarray(np.linalg.inv(np.linalg.inv(predicted) + information), np.float64)
        known = np.array([self.depth_latency, self.readout_time]) - covariance @ gradient
        if not (np.isfinite(known).all() and np.isfinite(covariance).all()):
            return self  # every later frame would inherit it
        latency, readout_time = np.clip(known, -_LIMIT_S, _LIMIT_S)
        return TimeOffsets(float(latency), float(readout_time), covariance)


def _terms(refinement: Refinement, problem: RefinementProblem) -> tuple[Float64, Float64]:
    """Hessian [8, 8] and gradient [8] for the pose, the depth's latency and the readout."""
    T, twist, finest = refinement.T_model_source, problem.view.twist, problem.at_level(0)
    planes, pixels = problem.model.planes, problem.model.pixels[0]
    rows = plane_rows(T, finest)
    now, then, by_readout_time = _moves(rows, T, twist, planes.velocity, planes.row_time)
    H, g = extended_normal_equations(rows, then - now, by_readout_time)
    rows = pixel_rows(T, finest, refinement.affine_brightness)
    *_, by_readout_time = _moves(rows, T, twist, pixels.velocity, pixels.row_time)
    # where a late depth moves along a surface, the depth of a pixel hardly changes
    by_latency = np.zeros_like(by_readout_time)
    H_pixels, g_pixels = extended_normal_equations(rows, by_latency, by_readout_time)
    return H + H_pixels, g + g_pixels


def _moves(
    rows: Rows, T: Float64, twist: Float64, velocity: Float64, row_time: Float64
) -> tuple[Float64, Float64, Float64]:
    """How residuals change per second of the camera's motion, now and then, and of readout time.

    Now is when the frame was taken, and then when the model's points were seen.
    """
    now = np.sum(rows.jacobian * (se3.adjoint(T) @ twist), axis=1)
    then = np.sum(rows.jacobian[:, :3] * velocity[rows.point], axis=1)
    return now, then, rows.row_time * now - row_time[rows.point] * then
