"""RGBD-Glue (Chen et al., 3DV 2025): visual matches tell which geometric matches to believe.

One function per equation; ``Glue.register`` reads like section 3 of the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from rgbd_glue_ros.features import GEOMETRIC, VISUAL
from rgbd_glue_ros.features.geometric import TransformPrior
from rgbd_glue_ros.features.visual import lift
from rgbd_glue_ros.geometry.fitting import (
    chi_squared,
    distances,
    procrustes,
    procrustes_information,
    randomised_procrustes,
    ransac,
)
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.registration.sc2_pcr import sc2_pcr
from rgbd_glue_ros.stopwatch import Stopwatch, timed
from rgbd_glue_ros.types import (
    Correspondences,
    Float64,
    RegistrationResult,
    RegistrationStatus,
    View,
)

R = TypeVar("R")

# The publication of SC2-PCR takes 10 cm indoors.
_GEOMETRIC_INLIER_M = 0.1


def assumed_inliers(
    matches: Correspondences, T: Float64, inlier_threshold: float, k: float
) -> Correspondences:
    """Equation 4: C_vis^in = {p, q in C_vis : |T p - q| <= K t_in}."""
    return matches.select(distances(T, matches) <= k * inlier_threshold)


def error_variance(inliers: Correspondences, T: Float64) -> float:
    """Equation 5: the moment estimate of sigma², the variance along one axis, m²."""
    return float(np.mean(distances(T, inliers) ** 2) / 3)


def adaptive_threshold(variance: float, confidence: float = 0.95) -> float:
    """Equations 6 and 7: epsilon = sqrt(sigma² chi²_confidence(3)), metres."""
    return float(np.sqrt(variance * chi_squared(confidence, 3)))


def consistent(matches: Correspondences, T: Float64, epsilon: float) -> Correspondences:
    """Equation 8: C_geo^in = {p, q in C_geo : |T p - q| <= epsilon}."""
    return matches.select(distances(T, matches) <= epsilon)


def surviving(
    matches: Correspondences, rough: TransformPrior, config: Config
) -> Correspondences | None:
    """Equation 8, or None where almost no match survives it.

    That are less than ``glue.min_credible``, or less than ``glue.over_chance`` times those that
    would survive had the points been matched at random: so many survive any transform.
    """
    survivors = consistent(matches, rough.T_target_source, rough.radius)
    order = np.random.default_rng(config.seed).permutation(len(matches))
    at_random = Correspondences(matches.source, matches.target[order], matches.weights)
    by_chance = len(consistent(at_random, rough.T_target_source, rough.radius))
    least = max(config.glue.min_credible, config.glue.over_chance * by_chance)
    return survivors if len(survivors) >= least else None


def geometric_rough(matches: Correspondences, config: Config) -> TransformPrior | None:
    """A rough transform from geometric matches alone, with the epsilon of equations 4 to 7."""
    T, agreeing = sc2_pcr(matches)
    if T is None or agreeing < config.glue.min_credible:
        return None
    glue = config.glue
    inliers = matches.select(distances(T, matches) <= _GEOMETRIC_INLIER_M)
    return TransformPrior(T, adaptive_threshold(error_variance(inliers, T), glue.confidence))


FALLBACKS: dict[str, Callable[[Correspondences, Config], TransformPrior | None]] = {
    "sc2_pcr": geometric_rough
}
"""What ``glue.fallback`` names beside none."""

FITS: dict[str, Callable[[Correspondences, Config, np.random.Generator], Float64 | None]] = {
    "randomised": lambda C, config, rng: randomised_procrustes(
        C, config.fit.subsets, config.fit.fraction, rng
    ),
    "procrustes": lambda C, _config, _rng: procrustes(C.source, C.target, C.weights),
    "ransac": lambda C, config, rng: ransac(
        C, config.glue.inlier_threshold, config.ransac.iterations, rng
    )[0],
}
"""What ``fit.method`` names (section 3.3)."""


@dataclass(frozen=True)
class FrameFeatures:
    """A frame and what was extracted from it.

    Attributes:
        view: the frame as the features saw it.
        visual: of the configured visual feature.
        geometric: of the configured geometric feature.
        stages_ms: wall time of each extraction, milliseconds.
    """

    view: View
    visual: Any
    geometric: Any
    stages_ms: dict[str, float]


class Glue:
    """Registers RGB-D frames by the features and parameters of a configuration."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._visual = VISUAL[config.features.visual](config.features)
        self._geometric = GEOMETRIC[config.features.geometric](config.features)

    @property
    def inlier_threshold(self) -> float:
        """t_in, the distance within which a visual match agrees with a transform, metres."""
        return self._config.glue.inlier_threshold

    def reconfigure(self, config: Config) -> None:
        """Takes other parameters, with the same features."""
        self._config = config

    def extract(self, view: View) -> FrameFeatures:
        """Section 3.1: visual and geometric features."""
        visual = timed(self._visual.extract, view)
        return _features(view, visual, timed(self._geometric.extract, view))

    def extract_on_two_threads(self, view: View, executor: Executor) -> FrameFeatures:
        """The same, with the geometric features extracted by an executor's thread."""
        geometric = executor.submit(timed, self._geometric.extract, view)
        return _features(view, timed(self._visual.extract, view), geometric.result())

    def with_other_depth(self, features: FrameFeatures, view: View) -> FrameFeatures:
        """The features of a view with the same colours but other depth."""
        return replace(features, view=view, geometric=self._geometric.extract(view))

    def register(
        self, source: FrameFeatures, target: FrameFeatures, prior: TransformPrior | None = None
    ) -> RegistrationResult:
        """The transform T_target_source of two frames (sections 3.1 to 3.3).

        Args:
            source: frame whose points are p.
            target: frame whose points are q.
            prior: a transform to search around when visual matches give none; None for the
                paper's method, which then skips the filter.

        Returns:
            The result; its status says why where there is no transform.
        """
        glue = self._config.glue
        rng = np.random.default_rng(self._config.seed)
        clock = Stopwatch()

        pixels = self._visual.match(source.visual, target.visual)
        C_vis = lift(pixels, source.view, target.view)
        clock.lap("visual_matching")

        T, agreeing = ransac(C_vis, glue.inlier_threshold, self._config.ransac.iterations, rng)
        clock.lap("ransac")

        C_vis_in, sigma, rough = Correspondences.empty(), float("nan"), prior
        if T is not None and agreeing >= self._config.ransac.min_inliers:
            C_vis_in = assumed_inliers(C_vis, T, glue.inlier_threshold, glue.k)
            if len(C_vis_in) >= glue.min_visual:
                variance = error_variance(C_vis_in, T)
                sigma = float(np.sqrt(variance))
                rough = TransformPrior(T, adaptive_threshold(variance, glue.confidence))
        guide = rough if glue.filter else None
        C_geo = self._geometric.match(source.geometric, target.geometric, guide)
        credible = None if guide is None else surviving(C_geo, guide, self._config)
        clock.lap("geometric_matching")

        if credible is None and glue.filter and glue.fallback in FALLBACKS:
            unguided = C_geo
            if guide is not None:
                unguided = self._geometric.match(source.geometric, target.geometric, None)
            found_again = FALLBACKS[glue.fallback](unguided, self._config)
            if found_again is not None:
                rough = found_again
                C_geo = self._geometric.match(source.geometric, target.geometric, rough)
                credible = surviving(C_geo, rough, self._config)
                T, sigma = rough.T_target_source, float("nan")
                C_vis_in = assumed_inliers(C_vis, T, glue.inlier_threshold, glue.k)
            clock.lap("fallback")

        filtered = credible is not None
        C_geo_in = C_geo if credible is None else credible
        C = C_vis_in + C_geo_in
        found = RegistrationResult(
            T_target_source=None,
            status=RegistrationStatus.TOO_FEW_CORRESPONDENCES,
            visual=C_vis,
            visual_inliers=C_vis_in,
            geometric=C_geo,
            credible=C_geo_in,
            filtered=filtered,
            sigma_m=sigma,
            epsilon_m=rough.radius if filtered and rough else float("nan"),
            stages_ms=clock.laps_ms,
        )
        if len(C) < glue.min_visual or not C.weights.any():
            return found
        T = FITS[self._config.fit.method](C, self._config, rng)
        clock.lap("fit")
        covariance = None if T is None else fit_covariance(T, C)
        if T is None or covariance is None:
            return found.refused(RegistrationStatus.DEGENERATE)
        return found.accepted(T, covariance)


def fit_covariance(T: Float64, matches: Correspondences) -> Float64 | None:
    """Covariance [6, 6] of the weighted Procrustes fit, from its own residuals.

    That of weighted least squares with independent errors of equal variance s²,
    H⁻¹ (sum w² JᵀJ s²) H⁻¹ with H = sum w JᵀJ; s² by moments as in equation 5.

    Returns:
        Order x y z rx ry rz, perturbation on the left, target frame; None when the matches leave
        a degree of freedom open.
    """
    H = procrustes_information(T, matches)
    scale = np.sqrt(np.diag(H))
    if (scale <= 0).any() or np.linalg.cond(H / np.outer(scale, scale)) > 1e8:
        return None
    w = matches.weights
    variance = float(w @ distances(T, matches) ** 2 / w.sum()) / 3
    squared = Correspondences(matches.source, matches.target, w**2)
    inverse = np.linalg.inv(H)
    covariance: Float64 = inverse @ (procrustes_information(T, squared) * variance) @ inverse
    symmetric: Float64 = (covariance + covariance.T) / 2
    return symmetric


def _features(view: View, visual: tuple[Any, float], geometric: tuple[Any, float]) -> FrameFeatures:
    """Features with the milliseconds that each took."""
    times = {"visual_features": visual[1], "geometric_features": geometric[1]}
    return FrameFeatures(view, visual[0], geometric[0], times)
