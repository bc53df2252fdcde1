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

from rgbd_glue_ros.camera import displaced
from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.config import RefineConfig, TimingConfig
from rgbd_glue_ros.model import Model
from rgbd_glue_ros.refinement import DAMPING, Refinement
from rgbd_glue_ros.residuals import (
    GATE_SIGMAS,
    brightness_at,
    gradient_at,
    in_camera,
    inside,
    plane_variance,
    seen_surface,
    shows_another,
)
from rgbd_glue_ros.types import Float32, Float64, UInt8, View

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
        H, g = _terms(found, model, source, refine)
        # what the residuals say of the timing whatever the pose
        elimination = H[6:, :6] @ np.linalg.inv(H[:6, :6] + DAMPING * np.eye(6))
        information = (H[6:, 6:] - elimination @ H[:6, 6:]) / config.correlation
        gradient = (g[6:] - elimination @ g[:6]) / config.correlation
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
    H, g = np.zeros((8, 8)), np.zeros(8)
    K, planes, pixels = source.intrinsics.focal_and_centre, model.planes, model.pixels[0]
    _add_planes(
        found.T_model_source,
        planes.points,
        planes.normals,
        planes.velocity,
        planes.part,
        source.depth,
        K,
        source.twist,
        source.readout,
        source.depth_delay,
        refine.plane_cauchy,
        H,
        g,
    )
    _add_pixels(
        found.T_model_source,
        pixels.points,
        pixels.brightness,
        pixels.velocity,
        pixels.part,
        source.grey,
        source.depth,
        K,
        source.twist,
        source.readout,
        source.depth_delay,
        found.light,
        refine.pixel_weight,
        refine.pixel_cauchy,
        H,
        g,
    )
    return H, g


@compiled
def _passing(x: float, y: float, z: float, twist: Float64) -> tuple[float, float, float]:
    """``apparent_velocity`` of one point."""
    return (
        twist[0] + twist[4] * z - twist[5] * y,
        twist[1] + twist[5] * x - twist[3] * z,
        twist[2] + twist[3] * y - twist[4] * x,
    )


@compiled
def _add_planes(
    T: Float64,
    points: Float64,
    normals: Float64,
    velocity: Float64,
    part: Float64,
    depth: Float32,
    K: Float64,
    twist: Float64,
    readout: float,
    delay: float,
    cauchy: float,
    H: Float64,
    g: Float64,
) -> None:
    J = np.empty(8)
    for i in range(len(points)):
        x, y, z, here = in_camera(T, points, i, K, depth.shape[0], twist, readout, delay)
        if z <= 0.0:
            continue
        x, y, z = seen_surface(depth, K, x, y, z)
        if not z > 0.0:
            continue
        x, y, z = displaced(x, y, z, delay + here * readout, twist)
        q0 = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        q1 = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        q2 = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        n0, n1, n2 = normals[i, 0], normals[i, 1], normals[i, 2]
        r = n0 * (q0 - points[i, 0]) + n1 * (q1 - points[i, 1]) + n2 * (q2 - points[i, 2])
        nx = T[0, 0] * n0 + T[1, 0] * n1 + T[2, 0] * n2
        ny = T[0, 1] * n0 + T[1, 1] * n1 + T[2, 1] * n2
        nz = T[0, 2] * n0 + T[1, 2] * n1 + T[2, 2] * n2
        variance = plane_variance(nx, ny, nz, x, y, z, K)
        squared = r * r / variance
        if squared > GATE_SIGMAS**2:
            continue
        w = 1.0 / (variance * (1.0 + squared / (cauchy * cauchy)))
        J[0], J[1], J[2] = n0, n1, n2
        J[3], J[4], J[5] = q1 * n2 - q2 * n1, q2 * n0 - q0 * n2, q0 * n1 - q1 * n0
        mx, my, mz = _passing(x, y, z, twist)
        now = nx * mx + ny * my + nz * mz
        then = n0 * velocity[i, 0] + n1 * velocity[i, 1] + n2 * velocity[i, 2]
        J[6] = then - now
        J[7] = here * now - part[i] * then
        for a in range(8):
            g[a] += w * r * J[a]
            for b in range(8):
                H[a, b] += w * J[a] * J[b]


@compiled
def _add_pixels(
    T: Float64,
    points: Float64,
    brightness: Float64,
    velocity: Float64,
    part: Float64,
    image: UInt8,
    depth: Float32,
    K: Float64,
    twist: Float64,
    readout: float,
    delay: float,
    light: Float64,
    weight: float,
    cauchy: float,
    H: Float64,
    g: Float64,
) -> None:
    J = np.empty(8)
    gain, bias, sigma = light[0], light[1], light[2]
    for i in range(len(points)):
        px, py, z, here = in_camera(T, points, i, K, image.shape[0], twist, readout, 0.0)
        if z <= 0.0:
            continue
        x, y = px / z, py / z
        u, v = K[0] * x + K[2], K[1] * y + K[3]
        there = displaced(px, py, z, -delay, twist)
        if not inside(image, u, v) or shows_another(depth, K, there[0], there[1], there[2]):
            continue
        r = gain * brightness_at(image, u, v) + bias - brightness[i]
        w = weight / (sigma * sigma * (1.0 + (r / (cauchy * sigma)) ** 2))
        gu, gv = gradient_at(image, u, v)
        gx, gy = gain * gu * K[0] / z, gain * gv * K[1] / z
        gz = -(gx * x + gy * y)
        for a in range(3):
            J[a] = -(gx * T[a, 0] + gy * T[a, 1] + gz * T[a, 2])
        J[3] = points[i, 1] * J[2] - points[i, 2] * J[1]
        J[4] = points[i, 2] * J[0] - points[i, 0] * J[2]
        J[5] = points[i, 0] * J[1] - points[i, 1] * J[0]
        mx, my, mz = _passing(px, py, z, twist)
        now = gx * mx + gy * my + gz * mz
        # a move of the point in the model does what the opposite move of the camera does
        then = -(J[0] * velocity[i, 0] + J[1] * velocity[i, 1] + J[2] * velocity[i, 2])
        # where a late depth moves along a surface, the depth of a pixel hardly changes
        J[6] = 0.0
        J[7] = part[i] * then - here * now
        for a in range(8):
            g[a] += w * r * J[a]
            for b in range(8):
                H[a, b] += w * J[a] * J[b]
