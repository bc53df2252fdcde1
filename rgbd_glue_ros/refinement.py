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

import cv2
import numpy as np
from numba import njit

from rgbd_glue_ros import se3
from rgbd_glue_ros.camera import (
    back_project,
    depth_at,
    depth_sigma,
    sample_depth,
)
from rgbd_glue_ros.config import RefineConfig
from rgbd_glue_ros.normals import grid_points_and_normals
from rgbd_glue_ros.types import Float32, Float64, Int64, UInt8, View

LEVELS = 3
# Edge of the cells that give one pixel each, at every level of the pyramid: coarse levels have
# fewer pixels, so their cells are smaller.
_CELLS_PX = (8, 5, 4)
_MIN_GRADIENT = 5.0
# Blur of depth edges and lens: a depth belongs to a pixel only to about this accuracy.
_LATERAL_SIGMA_PX = 0.5
# Farther than this many sigma apart, a plane and a depth are not the same surface.
_PLANE_GATE_SIGMAS = 10.0
_AGREEING_SIGMAS = 3.0
_CONVERGED = (2e-5, 5e-4, 1e-3)
# Keeps a direction that neither planes nor pixels see where the start put it.
_DAMPING = 100.0
_START_LIGHT = (1.0, 0.0, 15.0)


@dataclass(frozen=True)
class Planes:
    """Oriented points.

    Attributes:
        points: float64 [N, 3], metres.
        normals: float64 [N, 3], unit.
    """

    points: Float64
    normals: Float64


@dataclass(frozen=True)
class Pixels:
    """Points with the brightness that one level of an image pyramid has there.

    Attributes:
        points: float64 [N, 3], metres.
        brightness: float64 [N], grey levels.
    """

    points: Float64
    brightness: Float64


@dataclass(frozen=True)
class Model:
    """What poses are refined against, in one frame.

    Attributes:
        planes: surfaces.
        pixels: textured points, for each level of the pyramid, finest first.
    """

    planes: Planes
    pixels: tuple[Pixels, ...]

    def moved(self, T: Float64) -> Model:
        """The model in the frame that T [4, 4] maps to."""
        planes = Planes(se3.transform(T, self.planes.points), self.planes.normals @ T[:3, :3].T)
        pixels = tuple(Pixels(se3.transform(T, p.points), p.brightness) for p in self.pixels)
        return Model(planes, pixels)


def model_of(view: View, grid_step: int) -> Model:
    """The planes and pixels of a frame, in its optical frame.

    Args:
        view: the frame.
        grid_step: spacing of the planes, pixels.
    """
    points, normals = grid_points_and_normals(view.depth, view.intrinsics, grid_step)
    known = np.isfinite(points[..., 2])
    pixels = tuple(
        _textured_pixels(image, level, view) for level, image in enumerate(_pyramid(view.grey))
    )
    return Model(Planes(points[known], normals[known]), pixels)


def blend(models: Sequence[Model]) -> Model:
    """One model of several that are in the same frame, of the size of one of them.

    Takes every n-th plane and pixel of n models: to be refined against more keyframes costs
    nothing, and averages what is wrong with each.
    """
    every = slice(None, None, len(models))
    planes = Planes(
        np.concatenate([m.planes.points[every] for m in models]),
        np.concatenate([m.planes.normals[every] for m in models]),
    )
    pixels = tuple(
        Pixels(
            np.concatenate([m.pixels[level].points[every] for m in models]),
            np.concatenate([m.pixels[level].brightness[every] for m in models]),
        )
        for level in range(LEVELS)
    )
    return Model(planes, pixels)


@dataclass(frozen=True)
class Refinement:
    """A pose, and how well a model and a frame agree on it.

    Attributes:
        T_model_source: float64 [4, 4].
        information: float64 [6, 6], the Hessian at the pose, perturbation on the left.
        planes_seen: planes that project onto known depth.
        planes_agreeing: those that lie where the depth image has them.
        pixels_seen: pixels of the finest level inside the image.
        correlation: of their brightness in the model and in the image, from -1 to 1.
    """

    T_model_source: Float64
    information: Float64
    planes_seen: int
    planes_agreeing: int
    pixels_seen: int
    correlation: float

    @property
    def plane_agreement(self) -> float:
        """The part of the planes seen that agree; 0 where none is seen."""
        return self.planes_agreeing / max(self.planes_seen, 1)


def refine(T_model_source: Float64, model: Model, source: View, config: RefineConfig) -> Refinement:
    """Refines a pose by Gauss-Newton, coarse to fine.

    Args:
        T_model_source: start, float64 [4, 4].
        model: planes and pixels.
        source: the frame whose pose it is.
        config: steps at each level (0 only evaluates the start) and weights.
    """
    T = T_model_source
    images = _pyramid(source.grey)
    light = np.array(_START_LIGHT)
    for level in reversed(range(LEVELS)):
        for _ in range(config.iterations):
            H, g, _, _ = _linearise(T, model, images[level], level, source, config, light)
            step = np.asarray(np.linalg.solve(H + _DAMPING * np.eye(6), -g), np.float64)
            T = se3.exp(step) @ T
            if np.abs(step).max() < _CONVERGED[level]:
                break
    return judge(T, model, source, config)


def judge(T_model_source: Float64, model: Model, source: View, config: RefineConfig) -> Refinement:
    """How well a model and a frame agree on a pose, at full resolution."""
    light = np.array(_START_LIGHT)
    # brightness is compared under the gain and bias that the first look finds
    for _ in range(2):
        H, _, planes, pixels = _linearise(
            T_model_source, model, source.grey, 0, source, config, light
        )
    return Refinement(T_model_source, H, *planes, *pixels)


def _linearise(
    T: Float64,
    model: Model,
    image: UInt8,
    level: int,
    source: View,
    config: RefineConfig,
    light: Float64,
) -> tuple[Float64, Float64, tuple[int, int], tuple[int, float]]:
    """Hessian and gradient at T, and the counts of planes and pixels; updates ``light``."""
    K = source.intrinsics
    camera = np.array([K.fx, K.fy, K.cx, K.cy])
    H, g = np.zeros((6, 6)), np.zeros(6)
    thinned = slice(None, None, 2**level)
    planes = _add_planes(
        T,
        model.planes.points[thinned],
        model.planes.normals[thinned],
        source.depth,
        camera,
        config.plane_cauchy,
        H,
        g,
    )
    pixels = _add_pixels(
        T,
        model.pixels[level].points,
        model.pixels[level].brightness,
        image,
        camera / 2**level,  # pyrDown centres pixel i of a level on pixel 2 i of the one below
        light,
        config.pixel_weight,
        config.pixel_cauchy,
        H,
        g,
    )
    upper = np.triu_indices(6, 1)
    H[upper[::-1]] = H[upper]
    return H, g, planes, pixels


def _pyramid(grey: UInt8) -> list[UInt8]:
    images = [grey]
    for _ in range(LEVELS - 1):
        images.append(np.asarray(cv2.pyrDown(images[-1]), np.uint8))
    return images


def _textured_pixels(image: UInt8, level: int, view: View) -> Pixels:
    """The pixel with the strongest gradient in each cell of a level, where its depth is known."""
    rows = _strongest_gradients(image, _CELLS_PX[level], _MIN_GRADIENT)
    uv = rows[:, ::-1] * 2**level
    z = depth_at(view.depth, uv.astype(np.float32))
    known = np.isfinite(z)
    points = back_project(uv[known], z[known], view.intrinsics)
    return Pixels(points, image[rows[known, 0], rows[known, 1]].astype(np.float64))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _strongest_gradients(image: UInt8, cell: int, threshold: float) -> Int64:
    """Row and column, int64 [N, 2], of the strongest gradient above the threshold in each cell."""
    height, width = image.shape
    found = np.empty(((height // cell + 1) * (width // cell + 1), 2), np.int64)
    n = 0
    for top in range(2, height - 2, cell):
        for left in range(2, width - 2, cell):
            best = (2.0 * threshold) ** 2
            row, column = -1, -1
            for v in range(top, min(top + cell, height - 2)):
                for u in range(left, min(left + cell, width - 2)):
                    du = float(image[v, u + 1]) - float(image[v, u - 1])
                    dv = float(image[v + 1, u]) - float(image[v - 1, u])
                    if du * du + dv * dv > best:
                        best, row, column = du * du + dv * dv, v, u
            if row >= 0:
                found[n, 0], found[n, 1] = row, column
                n += 1
    return found[:n]


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _add_planes(
    T: Float64,
    points: Float64,
    normals: Float64,
    depth: Float32,
    K: Float64,
    cauchy: float,
    H: Float64,
    g: Float64,
) -> tuple[int, int]:
    """Adds the point-to-plane terms at T to g and to the upper half of H.

    Returns the planes seen and those of them that agree.
    """
    R, t = T[:3, :3], T[:3, 3]
    agreeing, seen = 0, 0
    J = np.empty(6)
    for i in range(len(points)):
        d0, d1, d2 = points[i, 0] - t[0], points[i, 1] - t[1], points[i, 2] - t[2]
        z = R[0, 2] * d0 + R[1, 2] * d1 + R[2, 2] * d2
        if z < 0.05:
            continue
        rx = (R[0, 0] * d0 + R[1, 0] * d1 + R[2, 0] * d2) / z
        ry = (R[0, 1] * d0 + R[1, 1] * d1 + R[2, 1] * d2) / z
        measured = sample_depth(depth, K[0] * rx + K[2], K[1] * ry + K[3])
        if not measured > 0.0:
            continue
        seen += 1
        n0, n1, n2 = normals[i, 0], normals[i, 1], normals[i, 2]
        # the measured point, in the model's frame
        x, y = rx * measured, ry * measured
        q0 = R[0, 0] * x + R[0, 1] * y + R[0, 2] * measured + t[0]
        q1 = R[1, 0] * x + R[1, 1] * y + R[1, 2] * measured + t[1]
        q2 = R[2, 0] * x + R[2, 1] * y + R[2, 2] * measured + t[2]
        r = n0 * (q0 - points[i, 0]) + n1 * (q1 - points[i, 1]) + n2 * (q2 - points[i, 2])
        # depth noise along the ray and lateral blur, both seen along the normal
        nx = R[0, 0] * n0 + R[1, 0] * n1 + R[2, 0] * n2
        ny = R[0, 1] * n0 + R[1, 1] * n1 + R[2, 1] * n2
        nz = R[0, 2] * n0 + R[1, 2] * n1 + R[2, 2] * n2
        along = depth_sigma(measured) * (nx * rx + ny * ry + nz)
        lateral = _LATERAL_SIGMA_PX * measured / K[0]
        variance = along * along + lateral * lateral * (nx * nx + ny * ny)
        squared = r * r / variance
        if squared > _PLANE_GATE_SIGMAS**2:
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
    return seen, agreeing


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _bilinear(image: UInt8, u: float, v: float) -> float:
    u0, v0 = int(u), int(v)
    a, b = u - u0, v - v0
    top = (1 - a) * image[v0, u0] + a * image[v0, u0 + 1]
    bottom = (1 - a) * image[v0 + 1, u0] + a * image[v0 + 1, u0 + 1]
    return float((1 - b) * top + b * bottom)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _add_pixels(
    T: Float64,
    points: Float64,
    brightness: Float64,
    image: UInt8,
    K: Float64,
    light: Float64,
    weight: float,
    cauchy: float,
    H: Float64,
    g: Float64,
) -> tuple[int, float]:
    """Adds the photometric terms at T to g and H's upper half; returns pixels seen, correlation.

    ``light`` holds gain and bias from the image's brightness to the model's and the spread of
    the residuals; it is estimated anew for the next call, as exposure changes between frames.
    """
    R, t = T[:3, :3], T[:3, 3]
    height, width = image.shape
    J = np.empty(6)
    gain, bias, sigma = light[0], light[1], light[2]
    seen, spread = 0, 0.0
    sw = sx = sy = sxx = sxy = syy = 0.0
    for i in range(len(points)):
        X0, X1, X2 = points[i, 0], points[i, 1], points[i, 2]
        d0, d1, d2 = X0 - t[0], X1 - t[1], X2 - t[2]
        z = R[0, 2] * d0 + R[1, 2] * d1 + R[2, 2] * d2
        if z < 0.05:
            continue
        x = (R[0, 0] * d0 + R[1, 0] * d1 + R[2, 0] * d2) / z
        y = (R[0, 1] * d0 + R[1, 1] * d1 + R[2, 1] * d2) / z
        u, v = K[0] * x + K[2], K[1] * y + K[3]
        if not (u >= 1.0 and v >= 1.0 and u < width - 2.0 and v < height - 2.0):
            continue
        value = _bilinear(image, u, v)
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
        gu = gain * 0.5 * (_bilinear(image, u + 1.0, v) - _bilinear(image, u - 1.0, v))
        gv = gain * 0.5 * (_bilinear(image, u, v + 1.0) - _bilinear(image, u, v - 1.0))
        w *= weight / (sigma * sigma)
        # the point moves by -R^T (v + omega x X) in the camera, for a left perturbation of T
        for a in range(3):
            J[a] = -gu * K[0] / z * (R[a, 0] - x * R[a, 2]) - gv * K[1] / z * (
                R[a, 1] - y * R[a, 2]
            )
        J[3] = X1 * J[2] - X2 * J[1]
        J[4] = X2 * J[0] - X0 * J[2]
        J[5] = X0 * J[1] - X1 * J[0]
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
