"""Joint refinement of a pose on planes and pixels, after the fit of the paper.

Pixels drift where texture is weak and planes slide where geometry is; together they do neither.
The residuals are those of projective point-to-plane ICP (Chen and Medioni 1992, Newcombe et al.
2011) divided by the depth noise, and of direct visual odometry (Steinbruecker, Sturm and Cremers
2011, Kerl et al. 2013) divided by their own spread, both with Cauchy weights, minimised by
Gauss-Newton from coarse to fine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rgbd_glue_ros import se3
from rgbd_glue_ros.camera import displaced
from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.config import RefineConfig
from rgbd_glue_ros.model import LEVELS, Model, pyramid
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

COARSE_TO_FINE = tuple(reversed(range(LEVELS)))
_AGREEING_SIGMAS = 3.0
# A step shorter than this, in metres and radians, ends the search; at the levels before the last
# one, which only have to find the next one's start, a longer one does.
_CONVERGED, _NEAR_ENOUGH = 1e-4, 5e-4
# Keeps a direction that neither planes nor pixels see where the start put it.
DAMPING = 100.0
_START_LIGHT = (1.0, 0.0, 15.0)


@dataclass(frozen=True)
class Refinement:
    """A pose, and how well a model and a frame agree on it.

    Attributes:
        T_model_source: float64 [4, 4].
        information: float64 [6, 6], the Hessian at the pose, perturbation on the left.
        planes_seen: planes that project onto known depth; at level l, of every 2^l-th.
        planes_agreeing: those that lie where the depth image has them.
        planes_hidden: those that something nearer hides.
        pixels_seen: pixels of the level judged at inside the image, where no other surface is.
        correlation: of their brightness in the model and in the image, from -1 to 1.
        light: float64 [3], gain and bias from the image's brightness to the model's, and the
            standard deviation of what is left.
    """

    T_model_source: Float64
    information: Float64
    planes_seen: int
    planes_agreeing: int
    planes_hidden: int
    pixels_seen: int
    correlation: float
    light: Float64

    @property
    def plane_agreement(self) -> float:
        """The part of the planes seen that agree; 0 where none is seen."""
        return self.planes_agreeing / max(self.planes_seen, 1)

    @property
    def planes_visible(self) -> int:
        """Planes seen that nothing nearer hides."""
        return self.planes_seen - self.planes_hidden


def refine(
    T_model_source: Float64,
    model: Model,
    source: View,
    config: RefineConfig,
    levels: Sequence[int] = COARSE_TO_FINE,
) -> Refinement:
    """Refines a pose by Gauss-Newton, coarse to fine.

    Args:
        T_model_source: start, float64 [4, 4].
        model: planes and pixels.
        source: the frame whose pose it is.
        config: steps at each level (0 only evaluates the start) and weights.
        levels: of the pyramid to take the steps at; the result is judged at the last.
    """
    images = pyramid(source.grey)
    light = np.array(_START_LIGHT)
    T = T_model_source
    for level in levels[:-1]:
        meeting = _meeting(model, images[level], level, source, config)
        T = _descended(T, meeting, light, config.iterations, _NEAR_ENOUGH)[0]
    finest = levels[-1]
    meeting = _meeting(model, images[finest], finest, source, config)
    return Refinement(*_descended(T, meeting, light, config.iterations, _CONVERGED))


def judge(
    T_model_source: Float64, model: Model, source: View, config: RefineConfig, level: int = 0
) -> Refinement:
    """How well a model and a frame agree on a pose, at a level of the pyramid."""
    image = pyramid(source.grey)[level] if level else source.grey
    meeting = _meeting(model, image, level, source, config)
    light = np.array(_START_LIGHT)
    # brightness is compared under the gain and bias that the first look finds
    _linearised(T_model_source, meeting, light)
    return Refinement(*_descended(T_model_source, meeting, light, 0, _CONVERGED))


class _Meeting(NamedTuple):
    """A model and a frame at one level of the pyramid: all that residuals are made of but T.

    Attributes:
        points: float64 [N, 3] of planes.
        normals: float64 [N, 3].
        depth: float32 [H, W] of the frame.
        K_depth: float64 [4], fx, fy, cx, cy.
        pixels: float64 [M, 3], textured points.
        brightness: float64 [M] of these.
        image: uint8 [H / 2^level, W / 2^level] of the frame.
        K_image: float64 [4].
        twist: float64 [6], how the camera moves.
        readout: of its shutter, seconds.
        delay: of its depth, seconds.
        plane_cauchy: residual, in standard deviations, at which a plane's weight is halved.
        pixel_cauchy: that of a pixel.
        pixel_weight: of a pixel beside a plane.
    """

    points: Float64
    normals: Float64
    depth: Float32
    K_depth: Float64
    pixels: Float64
    brightness: Float64
    image: UInt8
    K_image: Float64
    twist: Float64
    readout: float
    delay: float
    plane_cauchy: float
    pixel_cauchy: float
    pixel_weight: float


def _meeting(
    model: Model, image: UInt8, level: int, source: View, config: RefineConfig
) -> _Meeting:
    K = source.intrinsics.focal_and_centre
    thinned = slice(None, None, 2**level)
    return _Meeting(
        np.ascontiguousarray(model.planes.points[thinned]),
        np.ascontiguousarray(model.planes.normals[thinned]),
        source.depth,
        K,
        model.pixels[level].points,
        model.pixels[level].brightness,
        image,
        # pyrDown centres pixel i of a level on pixel 2 i of the one below
        K / 2**level,
        source.twist,
        source.readout,
        source.depth_delay,
        config.plane_cauchy,
        config.pixel_cauchy,
        config.pixel_weight,
    )


@compiled
def _descended(
    T: Float64, meeting: _Meeting, light: Float64, iterations: int, converged: float
) -> tuple[Float64, Float64, int, int, int, int, float, Float64]:
    """T after Gauss-Newton steps, until one is shorter than ``converged``, as ``Refinement``.

    What is said of it is from before that last step. ``light`` is updated.
    """
    for i in range(iterations + 1):
        used = light.copy()
        H, g, planes, pixels = _linearised(T, meeting, light)
        if i == iterations:
            break
        step = np.linalg.solve(H + DAMPING * np.eye(6), -g).astype(np.float64)
        T = se3.exp(step) @ T
        if np.abs(step).max() < converged:
            break
    return T, H, planes[0], planes[1], planes[2], pixels[0], pixels[1], used


@compiled
def _linearised(
    T: Float64, meeting: _Meeting, light: Float64
) -> tuple[Float64, Float64, tuple[int, int, int], tuple[int, float]]:
    """Hessian and gradient at T, and the counts of planes and pixels; updates ``light``."""
    H, g = np.zeros((6, 6)), np.zeros(6)
    pixels = _add_pixels(T, meeting, light, H, g)
    planes = _add_planes(T, meeting, H, g)
    for a in range(6):
        for b in range(a):
            H[a, b] = H[b, a]
    return H, g, planes, pixels


@compiled
def _add_planes(T: Float64, meeting: _Meeting, H: Float64, g: Float64) -> tuple[int, int, int]:
    """Adds the point-to-plane terms at T to g and to the upper half of H.

    Returns the planes seen, those of them that agree, and those that something nearer hides.
    """
    points, normals, depth, K = meeting.points, meeting.normals, meeting.depth, meeting.K_depth
    twist, readout, delay = meeting.twist, meeting.readout, meeting.delay
    cauchy = meeting.plane_cauchy
    seen, agreeing, hidden = 0, 0, 0
    J = np.empty(6)
    for i in range(len(points)):
        x, y, z, part = in_camera(T, points, i, K, depth.shape[0], twist, readout, delay)
        if z <= 0.0:
            continue
        expected = z
        x, y, z = seen_surface(depth, K, x, y, z)
        if not z > 0.0:
            continue
        nearer = z < expected
        x, y, z = displaced(x, y, z, delay + part * readout, twist)
        seen += 1
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
            hidden += int(nearer)
            continue
        if squared < _AGREEING_SIGMAS**2:
            agreeing += 1
        w = 1.0 / (variance * (1.0 + squared / (cauchy * cauchy)))
        J[0], J[1], J[2] = n0, n1, n2
        J[3], J[4], J[5] = q1 * n2 - q2 * n1, q2 * n0 - q0 * n2, q0 * n1 - q1 * n0
        for a in range(6):
            g[a] += w * r * J[a]
            for b in range(a, 6):
                H[a, b] += w * J[a] * J[b]
    return seen, agreeing, hidden


@compiled
def _add_pixels(
    T: Float64, meeting: _Meeting, light: Float64, H: Float64, g: Float64
) -> tuple[int, float]:
    """Adds the photometric terms at T to g and H's upper half; returns pixels seen, correlation.

    ``light`` is as in ``Refinement``; it is estimated anew for the next call, as exposure changes
    between frames.
    """
    points, brightness = meeting.pixels, meeting.brightness
    image, K = meeting.image, meeting.K_image
    twist, readout = meeting.twist, meeting.readout
    weight, cauchy = meeting.pixel_weight, meeting.pixel_cauchy
    J = np.empty(6)
    gain, bias, sigma = light[0], light[1], light[2]
    seen, spread = 0, 0.0
    sw = sx = sy = sxx = sxy = syy = 0.0
    for i in range(len(points)):
        x, y, z, _ = in_camera(T, points, i, K, image.shape[0], twist, readout, 0.0)
        if z <= 0.0:
            continue
        there = displaced(x, y, z, -meeting.delay, twist)
        x, y = x / z, y / z
        u, v = K[0] * x + K[2], K[1] * y + K[3]
        if not inside(image, u, v):
            continue
        # where an edge passes in front, or what was seen has moved away
        if shows_another(meeting.depth, meeting.K_depth, there[0], there[1], there[2]):
            continue
        value = brightness_at(image, u, v)
        r = gain * value + bias - brightness[i]
        seen += 1
        spread += min(abs(r), _AGREEING_SIGMAS * sigma)
        w = 1.0 / (1.0 + (r / (cauchy * sigma)) ** 2)
        sw += w
        sx += w * value
        sy += w * brightness[i]
        sxx += w * value * value
        sxy += w * value * brightness[i]
        syy += w * brightness[i] * brightness[i]
        gu, gv = gradient_at(image, u, v)
        gx, gy = gain * gu * K[0] / z, gain * gv * K[1] / z
        w *= weight / (sigma * sigma)
        # the point moves by -R^T (v + omega x X) in the camera, for a left perturbation of T
        for a in range(3):
            J[a] = -gx * (T[a, 0] - x * T[a, 2]) - gy * (T[a, 1] - y * T[a, 2])
        J[3] = points[i, 1] * J[2] - points[i, 2] * J[1]
        J[4] = points[i, 2] * J[0] - points[i, 0] * J[2]
        J[5] = points[i, 0] * J[1] - points[i, 1] * J[0]
        for a in range(6):
            g[a] += w * r * J[a]
            for b in range(a, 6):
                H[a, b] += w * J[a] * J[b]
    if sw < 10.0:
        return seen, 0.0
    var_x, var_y = sxx / sw - (sx / sw) ** 2, syy / sw - (sy / sw) ** 2
    covariance = sxy / sw - sx / sw * sy / sw
    light[0] = min(max(covariance / max(var_x, 1.0), 0.5), 2.0)
    light[1] = sy / sw - light[0] * sx / sw
    # 1.25 mean |r| is the standard deviation of a normal distribution
    light[2] = min(max(1.25 * spread / seen, 2.0), 30.0)
    return seen, covariance / max(np.sqrt(max(var_x, 0.0) * max(var_y, 0.0)), 1.0)
