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

import numpy as np

from rgbd_glue_ros.compiled import compiled, inlined
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.depth import SURFACE_SIGMAS
from rgbd_glue_ros.parameters import RefineConfig
from rgbd_glue_ros.refinement.model import LEVELS, Model, pyramid
from rgbd_glue_ros.refinement.residuals import (
    LevelProblem,
    Six,
    level_problem,
    pixel_residual,
    plane_residual,
)
from rgbd_glue_ros.types import Float64, View

COARSE_TO_FINE = tuple(reversed(range(LEVELS)))
_AGREEING_SIGMAS = 3.0
# A step shorter than this, in metres and radians, ends the search; at the levels before the last
# one, which only have to find the next one's start, a longer one does.
_CONVERGED, _NEAR_ENOUGH = 1e-4, 5e-4
# Keeps a direction that neither planes nor pixels see where the start put it.
DAMPING = 100.0
# What is assumed of the light before anything is compared.
START_BRIGHTNESS = (1.0, 0.0, 15.0)


@dataclass(frozen=True)
class Refinement:
    """A pose, and how well a model and a frame agree on it.

    Attributes:
        T_model_source: float64 [4, 4].
        information: float64 [6, 6], the Hessian at the pose, perturbation on the left.
        planes_seen: planes that project onto known depth; at level l, of every 2^l-th.
        planes_agreeing: those that lie where the depth image has them.
        planes_occluded: those that something nearer hides.
        pixels_seen: pixels of the level judged at inside the image, where no other surface is.
        brightness_correlation: of their brightness in the model and in the image, from -1 to 1.
        affine_brightness: float64 [3], gain and bias from the image's brightness to the model's,
            and the standard deviation of what is left.
    """

    T_model_source: Float64
    information: Float64
    planes_seen: int
    planes_agreeing: int
    planes_occluded: int
    pixels_seen: int
    brightness_correlation: float
    affine_brightness: Float64

    @property
    def plane_agreement(self) -> float:
        """The part of the planes seen that agree; 0 where none is seen."""
        return self.planes_agreeing / max(self.planes_seen, 1)

    @property
    def planes_visible(self) -> int:
        """Planes seen that nothing nearer hides."""
        return self.planes_seen - self.planes_occluded


def refine(
    T_model_source: Float64,
    model: Model,
    source: View,
    config: RefineConfig,
    levels: Sequence[int] = COARSE_TO_FINE,
    affine_brightness: Sequence[float] | Float64 = START_BRIGHTNESS,
) -> Refinement:
    """Refines a pose by Gauss-Newton, coarse to fine.

    Args:
        T_model_source: start, float64 [4, 4].
        model: planes and pixels.
        source: the frame whose pose it is.
        config: steps at each level (0 only evaluates the start) and weights.
        levels: of the pyramid to take the steps at; the result is judged at the last.
        affine_brightness: as of ``Refinement``, as far as it is known.
    """
    images = pyramid(source.grey, max(levels) + 1)
    affine_brightness = np.array(affine_brightness)
    T = T_model_source
    for level in levels[:-1]:
        problem = level_problem(model, images[level], level, source, config)
        T = _descended(T, problem, affine_brightness, config.iterations, _NEAR_ENOUGH)[0]
    finest = levels[-1]
    problem = level_problem(model, images[finest], finest, source, config)
    return Refinement(*_descended(T, problem, affine_brightness, config.iterations, _CONVERGED))


def evaluate_pose(
    T_model_source: Float64, model: Model, source: View, config: RefineConfig, level: int = 0
) -> Refinement:
    """How well a model and a frame agree on a pose, at a level of the pyramid."""
    image = pyramid(source.grey, level + 1)[level]
    problem = level_problem(model, image, level, source, config)
    affine_brightness = np.array(START_BRIGHTNESS)
    # brightness is compared under the gain and bias that the first look finds
    _linearised(T_model_source, problem, affine_brightness)
    return Refinement(*_descended(T_model_source, problem, affine_brightness, 0, _CONVERGED))


def marginalise_pose(H: Float64, g: Float64) -> tuple[Float64, Float64]:
    """What residuals say of their other unknowns, whatever the pose.

    Args:
        H: float64 [6 + K, 6 + K], Hessian for the pose and K other unknowns.
        g: float64 [6 + K], gradient.

    Returns:
        Hessian [K, K] and gradient [K] of the others, with the pose eliminated.
    """
    elimination = H[6:, :6] @ np.linalg.inv(H[:6, :6] + DAMPING * np.eye(6))
    return H[6:, 6:] - elimination @ H[:6, 6:], g[6:] - elimination @ g[:6]


@compiled
def _descended(
    T: Float64, problem: LevelProblem, affine_brightness: Float64, iterations: int, converged: float
) -> tuple[Float64, Float64, int, int, int, int, float, Float64]:
    """T after Gauss-Newton steps, until one is shorter than ``converged``, as ``Refinement``.

    What is said of it is from before that last step. ``affine_brightness`` is updated.
    """
    for i in range(iterations + 1):
        used = affine_brightness.copy()
        H, g, planes, pixels = _linearised(T, problem, affine_brightness)
        if i == iterations:
            break
        step = np.linalg.solve(H + DAMPING * np.eye(6), -g).astype(np.float64)
        T = se3.exp(step) @ T
        if np.abs(step).max() < converged:
            break
    return T, H, planes[0], planes[1], planes[2], pixels[0], pixels[1], used


@compiled
def _linearised(
    T: Float64, problem: LevelProblem, affine_brightness: Float64
) -> tuple[Float64, Float64, tuple[int, int, int], tuple[int, float]]:
    """Hessian and gradient at T, the counts of planes, of pixels; updates the brightness."""
    H, g = np.zeros((6, 6)), np.zeros(6)
    pixels = _add_pixels(T, problem, affine_brightness, H, g)
    planes = _add_planes(T, problem, H, g)
    for a in range(6):
        for b in range(a):
            H[a, b] = H[b, a]
    return H, g, planes, pixels


@compiled
def _add_planes(T: Float64, problem: LevelProblem, H: Float64, g: Float64) -> tuple[int, int, int]:
    """Adds the point-to-plane terms at T to g and to the upper half of H.

    Returns the planes seen, those of them that agree, and those that something nearer hides.
    """
    points, normals, depth, K = problem.points, problem.normals, problem.depth, problem.K_depth
    twist, readout_time, delay = problem.twist, problem.readout_time, problem.delay
    cauchy = problem.plane_cauchy
    seen, agreeing, hidden = 0, 0, 0
    for i in range(len(points)):
        is_seen, is_nearer, squared, w, r, J, _ = plane_residual(
            T, points, normals, i, depth, K, twist, readout_time, delay, cauchy
        )
        if not is_seen:
            continue
        seen += 1
        if squared > SURFACE_SIGMAS**2:
            hidden += int(is_nearer)
            continue
        if squared < _AGREEING_SIGMAS**2:
            agreeing += 1
        _add(w, r, J, H, g)
    return seen, agreeing, hidden


@inlined
def _add(w: float, r: float, J: Six, H: Float64, g: Float64) -> None:
    """Adds the terms of a residual to g and to the upper half of H."""
    for a in range(6):
        g[a] += w * r * J[a]
        for b in range(a, 6):
            H[a, b] += w * J[a] * J[b]


@compiled
def _add_pixels(
    T: Float64, problem: LevelProblem, affine_brightness: Float64, H: Float64, g: Float64
) -> tuple[int, float]:
    """Adds the photometric terms at T to g and H's upper half; returns pixels seen, correlation.

    ``affine_brightness`` is as in ``Refinement``. It is estimated anew for the next call, as
    exposure changes between frames.
    """
    points, brightness = problem.pixels, problem.brightness
    image, K = problem.image, problem.K_image
    depth, K_depth = problem.depth, problem.K_depth
    twist, readout_time, delay = problem.twist, problem.readout_time, problem.delay
    weight, cauchy = problem.pixel_weight, problem.pixel_cauchy
    sigma = affine_brightness[2]
    seen, spread = 0, 0.0
    sw = sx = sy = sxx = sxy = syy = 0.0
    for i in range(len(points)):
        is_seen, value, w, r, J, _ = pixel_residual(
            T,
            points,
            brightness,
            i,
            image,
            K,
            depth,
            K_depth,
            twist,
            readout_time,
            delay,
            affine_brightness,
            cauchy,
        )
        if not is_seen:
            continue
        seen += 1
        spread += min(abs(r), _AGREEING_SIGMAS * sigma)
        sw += w
        sx += w * value
        sy += w * brightness[i]
        sxx += w * value * value
        sxy += w * value * brightness[i]
        syy += w * brightness[i] * brightness[i]
        w *= weight / (sigma * sigma)
        _add(w, r, J, H, g)
    if sw < 10.0:
        return seen, 0.0
    var_x, var_y = sxx / sw - (sx / sw) ** 2, syy / sw - (sy / sw) ** 2
    covariance = sxy / sw - sx / sw * sy / sw
    affine_brightness[0] = min(max(covariance / max(var_x, 1.0), 0.5), 2.0)
    affine_brightness[1] = sy / sw - affine_brightness[0] * sx / sw
    # 1.25 mean |r| is the standard deviation of a normal distribution
    affine_brightness[2] = min(max(1.25 * spread / seen, 2.0), 30.0)
    return seen, covariance / max(np.sqrt(max(var_x, 0.0) * max(var_y, 0.0)), 1.0)
