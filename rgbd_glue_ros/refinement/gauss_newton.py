"""Joint refinement of a pose on planes and pixels, after the fit of the paper.

Pixels drift where texture is weak, and planes slide where geometry is weak; together they do
neither. The residuals are those of projective point-to-plane ICP (Chen and Medioni 1992, Newcombe
et al. 2011), divided by the depth noise, and those of direct visual odometry (Steinbruecker, Sturm
and Cremers 2011, Kerl et al. 2013), divided by their own spread. Both have Cauchy weights, and are
minimised by Gauss-Newton from coarse to fine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.refinement.level_problem import LevelProblem
from rgbd_glue_ros.refinement.match_residuals import add_matches
from rgbd_glue_ros.refinement.model import LEVELS
from rgbd_glue_ros.refinement.normal_equations import damped, mirror_upper_triangle
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.residuals import (
    AGREEING_SIGMAS,
    DEVIATION_OF_MEAN,
    PlaneFit,
    Residuals,
    pixel_residuals,
    plane_residuals,
    weight_of_pixels,
)
from rgbd_glue_ros.types import Float64

COARSE_TO_FINE = tuple(reversed(range(LEVELS)))
# The last level stops after a step with no component as long as this, metres or radians.
_CONVERGED = 1e-4
# The coarser levels only find a start for the next, and stop after a longer step.
_NEAR_ENOUGH = 5e-4
# With a smaller sum of the robust weights of pixels, brightness is not compared.
_LEAST_PIXEL_WEIGHT = 10.0
# Limits of the gain: exposure changes by no more between two frames.
_LEAST_GAIN, _GREATEST_GAIN = 0.5, 2.0
# Smallest standard deviation of brightness, grey levels in a well-lit image.
_LEAST_DEVIATION = 2.0
# Greatest standard deviation of brightness, grey levels: with more, any pixel would agree.
_GREATEST_DEVIATION = 30.0
# Gain, bias and standard deviation to start with, before any brightness is compared.
START_BRIGHTNESS = (1.0, 0.0, 15.0)


@dataclass(frozen=True)
class Refinement:
    """A pose, and how well a model and a frame agree on it.

    Attributes:
        T_model_source: float64 [4, 4].
        information: float64 [6, 6], the Hessian at the pose, for a perturbation on the left.
        planes_seen: number of planes that project onto known depth; at level l, of every 2^l-th.
        planes_agreeing: number of these that agree with the depth image.
        planes_occluded: number of these that a nearer surface hides.
        pixels_seen: number of pixels that project into the image and are not occluded, at the level
            that the pose is evaluated at.
        brightness_correlation: correlation of their brightness in the model and in the image, from
            -1 to 1.
        affine_brightness: float64 [3], gain and bias from the image's brightness to the model's,
            and the standard deviation of the remaining difference.
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
        """The fraction of the seen planes that agree; 0 if none is seen."""
        return self.planes_agreeing / max(self.planes_seen, 1)

    @property
    def planes_visible(self) -> int:
        """Number of seen planes that are not occluded."""
        return self.planes_seen - self.planes_occluded

    @property
    def visible_agreement(self) -> float:
        """The fraction of the visible planes that agree; 0 if there are none."""
        return self.planes_agreeing / max(self.planes_visible, 1)


def refine(
    T_model_source: Float64,
    problem: RefinementProblem,
    levels: Sequence[int] = COARSE_TO_FINE,
    affine_brightness: Sequence[float] | Float64 = START_BRIGHTNESS,
) -> Refinement:
    """Refines a pose by Gauss-Newton, coarse to fine.

    Args:
        T_model_source: start, float64 [4, 4].
        problem: the model and the frame.
        levels: pyramid levels, in the order of the steps; the result is evaluated at the last.
        affine_brightness: as in ``Refinement``, if already known.
    """
    *coarse, final = levels
    steps = problem.config.iterations
    T, brightness = T_model_source, np.array(affine_brightness)
    for level in coarse:
        descent = _descend(T, problem.at_level(level), brightness, steps, _NEAR_ENOUGH)
        T, brightness = descent.T, descent.next_affine_brightness
    return _refinement(_descend(T, problem.at_level(final), brightness, steps, _CONVERGED))


def refine_at(
    T_model_source: Float64, problem: LevelProblem, affine_brightness: Float64, iterations: int
) -> Refinement:
    """Refines a pose at one level; the problem may contain only a part of a model.

    Args:
        T_model_source: start, float64 [4, 4].
        problem: planes, pixels and the frame.
        affine_brightness: as in ``Refinement``.
        iterations: Gauss-Newton steps, at most.
    """
    brightness = np.array(affine_brightness)
    return _refinement(_descend(T_model_source, problem, brightness, iterations, _NEAR_ENOUGH))


def evaluate_pose(
    T_model_source: Float64, problem: RefinementProblem, level: int = 0
) -> Refinement:
    """How well planes and pixels agree with a pose, at a pyramid level.

    Matches are left out: they constrain a search, but do not show how well the images agree.
    """
    of_level = problem.without_matches().at_level(level)
    # compare brightness with the gain and bias that a first pass finds
    first = _linearise(T_model_source, of_level, np.array(START_BRIGHTNESS))
    brightness = first.pixels.next_affine_brightness
    return _refinement(_descend(T_model_source, of_level, brightness, 0, _CONVERGED))


class _PixelFit(NamedTuple):
    """Pixels seen, the correlation of their brightness, and the affine brightness that fits best.

    Exposure changes between frames, so the affine brightness is estimated again for each step.
    """

    seen: int
    correlation: float
    next_affine_brightness: Float64


class _Linearisation(NamedTuple):
    """Hessian [6, 6] and gradient [6] at a pose, and how planes and pixels agree there."""

    H: Float64
    g: Float64
    planes: PlaneFit
    pixels: _PixelFit


class _Descent(NamedTuple):
    """The result of Gauss-Newton, and the linearisation before its last step."""

    T: Float64
    H: Float64
    planes: PlaneFit
    pixels: _PixelFit
    affine_brightness: Float64
    next_affine_brightness: Float64


def _refinement(descent: _Descent) -> Refinement:
    return Refinement(
        T_model_source=descent.T,
        information=descent.H,
        planes_seen=descent.planes.seen,
        planes_agreeing=descent.planes.agreeing,
        planes_occluded=descent.planes.occluded,
        pixels_seen=descent.pixels.seen,
        brightness_correlation=descent.pixels.correlation,
        affine_brightness=descent.affine_brightness,
    )


@compiled
def _descend(
    T: Float64,
    problem: LevelProblem,
    affine_brightness: Float64,
    iterations: int,
    converged: float,
) -> _Descent:
    """Takes at most ``iterations`` Gauss-Newton steps from T, until one is below ``converged``."""
    brightness = affine_brightness
    for i in range(iterations + 1):
        used = brightness
        H, g, planes, pixels = _linearise(T, problem, used)
        brightness = pixels.next_affine_brightness
        if i == iterations:
            break
        step = np.linalg.solve(damped(H), -g).astype(np.float64)
        T = se3.exp(step) @ T
        if np.abs(step).max() < converged:
            break
    return _Descent(T, H, planes, pixels, used, brightness)


@compiled
def _linearise(T: Float64, problem: LevelProblem, affine_brightness: Float64) -> _Linearisation:
    """The normal equations at T, of planes, pixels and matches."""
    H, g = np.zeros((6, 6)), np.zeros(6)
    of_planes, _, planes = plane_residuals(T, problem)
    _add(of_planes, 1.0, H, g)
    sigma, weight = affine_brightness[2], weight_of_pixels(problem, planes)
    of_pixels, brightness = pixel_residuals(T, problem, affine_brightness)
    _add(of_pixels, weight / (sigma * sigma), H, g)
    pixels = _pixel_fit(of_pixels, brightness, problem, affine_brightness)
    add_matches(T, problem, H, g)
    mirror_upper_triangle(H)
    return _Linearisation(H, g, planes, pixels)


@compiled
def _add(residuals: Residuals, scale: float, H: Float64, g: Float64) -> None:
    """Adds residuals, their weights scaled, to g and to the upper triangle of H."""
    weight, residual, J = residuals.weight, residuals.residual, residuals.jacobian
    for i in range(len(weight)):
        if weight[i] == 0.0:
            continue
        for a in range(6):
            by_a = scale * weight[i] * J[a, i]
            g[a] += by_a * residual[i]
            for b in range(a, 6):
                H[a, b] += by_a * J[b, i]


@compiled
def _pixel_fit(
    residuals: Residuals, brightness: Float64, problem: LevelProblem, affine_brightness: Float64
) -> _PixelFit:
    """How the brightness [M] of the image fits that of the pixels, which have these residuals."""
    expected, most = problem.brightness, AGREEING_SIGMAS * affine_brightness[2]
    seen, differences = 0, 0.0
    sw = sx = sy = sxx = sxy = syy = 0.0
    for i in range(len(brightness)):
        w = residuals.weight[i]
        if w == 0.0:
            continue
        x, y = brightness[i], expected[i]
        seen += 1
        differences += min(abs(residuals.residual[i]), most)
        sw += w
        sx += w * x
        sy += w * y
        sxx += w * x * x
        sxy += w * x * y
        syy += w * y * y
    if sw < _LEAST_PIXEL_WEIGHT:
        return _PixelFit(seen, 0.0, affine_brightness)
    var_x, var_y = sxx / sw - (sx / sw) ** 2, syy / sw - (sy / sw) ** 2
    covariance = sxy / sw - sx / sw * sy / sw
    least_variance = problem.contrast**2
    gain = min(max(covariance / max(var_x, least_variance), _LEAST_GAIN), _GREATEST_GAIN)
    bias = sy / sw - gain * sx / sw
    least_deviation = _LEAST_DEVIATION * problem.contrast
    deviation = max(DEVIATION_OF_MEAN * differences / seen, least_deviation)
    correlation = covariance / max(np.sqrt(max(var_x, 0.0) * max(var_y, 0.0)), least_variance)
    return _PixelFit(seen, correlation, np.array([gain, bias, min(deviation, _GREATEST_DEVIATION)]))
