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
from rgbd_glue_ros.parameters import RefineConfig, TimingConfig
from rgbd_glue_ros.refinement.gauss_newton import Refinement, beyond_the_pose
from rgbd_glue_ros.refinement.model import Model
from rgbd_glue_ros.refinement.residuals import Rows, meet, normal_equations, pixel_rows, plane_rows
from rgbd_glue_ros.types import Float64, View

# No driver is later, and no camera of a moving robot reads slower.
_LIMIT_S = 0.05

PRIMESENSE_FRAMES = "openni"
"""How OpenNI's drivers, and what was recorded with them, begin the name of the camera's frame."""

# Kinect v1 and Xtion: planes and pixels of one of each agree best with 15 to 20 ms and 26 ms.
_PRIMESENSE_LATENCY_S, _PRIMESENSE_READOUT_S = 0.017, 0.026


@dataclass(frozen=True)
class Timing:
    """What is known of a camera's timing.

    Attributes:
        depth_latency: how much later depth is stamped than colour of the same moment, seconds.
        readout: from the first row of an image to the last, seconds; 0 for a global shutter,
            negative where the last row is read first.
        covariance: float64 [2, 2] of both, s².
    """

    depth_latency: float
    readout: float
    covariance: Float64

    @staticmethod
    def start(config: TimingConfig, frame_id: str) -> Timing:
        """What is known before the first frame, whose camera has the frame ``frame_id``.

        A spread of 0 in the configuration is somebody's own calibration, and is left alone.
        """
        if config.spread > 0 and frame_id.startswith(PRIMESENSE_FRAMES):
            return Timing(_PRIMESENSE_LATENCY_S, _PRIMESENSE_READOUT_S, np.zeros((2, 2)))
        return Timing(config.depth_latency, config.readout, np.eye(2) * config.spread**2)

    @property
    def settled(self) -> bool:
        """Whether it is known, so that images have nothing to add."""
        return not self.covariance.any()

    def corrected(
        self,
        found: Refinement,
        model: Model,
        source: View,
        refine: RefineConfig,
        config: TimingConfig,
    ) -> Timing:
        """The timing after a frame.

        Args:
            found: the frame's pose in the model.
            model: which it was found in.
            source: the frame, with the velocity that it had.
            refine: weights of the residuals.
            config: how fast the timing drifts.
        """
        H, g = beyond_the_pose(*_terms(found, model, source, refine))
        information, gradient = H / config.correlation, g / config.correlation
        predicted = self.covariance + np.eye(2) * config.drift**2
        covariance = np.asarray(np.linalg.inv(np.linalg.inv(predicted) + information), np.float64)
        known = np.array([self.depth_latency, self.readout]) - covariance @ gradient
        if not (np.isfinite(known).all() and np.isfinite(covariance).all()):
            return self  # every later frame would inherit it
        latency, readout = np.clip(known, -_LIMIT_S, _LIMIT_S)
        return Timing(float(latency), float(readout), covariance)


def _terms(
    found: Refinement, model: Model, source: View, refine: RefineConfig
) -> tuple[Float64, Float64]:
    """Hessian [8, 8] and gradient [8] for the pose, the depth's latency and the readout."""
    T, planes, pixels = found.T_model_source, model.planes, model.pixels[0]
    meeting = meet(model, source.grey, 0, source, refine)
    seen = plane_rows(T, meeting)
    now, then, by_readout = _moves(seen, T, source.twist, planes.velocity, planes.part)
    H, g = _normal_equations(seen, then - now, by_readout)
    seen = pixel_rows(T, meeting, found.light)
    *_, by_readout = _moves(seen, T, source.twist, pixels.velocity, pixels.part)
    # where a late depth moves along a surface, the depth of a pixel hardly changes
    H_pixels, g_pixels = _normal_equations(seen, np.zeros_like(by_readout), by_readout)
    return H + H_pixels, g + g_pixels


def _moves(
    rows: Rows, T: Float64, twist: Float64, velocity: Float64, part: Float64
) -> tuple[Float64, Float64, Float64]:
    """How residuals change per second of the camera's way now and then, and of readout."""
    now = np.sum(rows.jacobian * (se3.adjoint(T) @ twist), axis=1)
    then = np.sum(rows.jacobian[:, :3] * velocity[rows.point], axis=1)
    return now, then, rows.part * now - part[rows.point] * then


def _normal_equations(
    rows: Rows, by_latency: Float64, by_readout: Float64
) -> tuple[Float64, Float64]:
    J = np.column_stack([rows.jacobian, by_latency, by_readout])
    return normal_equations(J, rows.weight, rows.residual)
