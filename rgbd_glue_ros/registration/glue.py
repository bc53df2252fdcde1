"""RGBD-Glue (Chen et al., 3DV 2025): visual matches select the credible geometric matches.

One function per equation; ``Glue.register`` follows section 3 of the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from rgbd_glue_ros.features import GEOMETRIC, VISUAL
from rgbd_glue_ros.features.lifting import KeypointPoints, lift
from rgbd_glue_ros.features.visual import KeypointFeature, check_matches
from rgbd_glue_ros.geometry.fitting import distances, fit_covariance, ransac
from rgbd_glue_ros.geometry.gates import chi_squared
from rgbd_glue_ros.parameters import SC2_PCR, Config
from rgbd_glue_ros.registration.fits import FITS
from rgbd_glue_ros.registration.frame_features import (
    Described,
    FeaturesInProgress,
    FrameFeatures,
    KeypointFeatures,
)
from rgbd_glue_ros.registration.sc2_pcr import INLIER_M, sc2_pcr
from rgbd_glue_ros.stopwatch import Stopwatch, timed
from rgbd_glue_ros.types import (
    Correspondences,
    Float64,
    RegistrationResult,
    RegistrationStatus,
    TransformPrior,
    View,
    stages,
)


def assumed_inliers(
    matches: Correspondences, T: Float64, inlier_threshold: float, k: float
) -> Correspondences:
    """Equation 4: C_vis^in = {p, q in C_vis : |T p - q| <= K t_in}."""
    return matches.select(distances(T, matches) <= k * inlier_threshold)


def error_variance(inliers: Correspondences, T: Float64) -> float:
    """Equation 5: the moment estimate of sigma², the variance along one axis, m²."""
    return float(np.mean(distances(T, inliers) ** 2) / 3)


def adaptive_threshold(variance: float, confidence: float) -> float:
    """Equations 6 and 7: epsilon = sqrt(sigma² chi²_confidence(3)), metres."""
    return float(np.sqrt(variance * chi_squared(confidence, 3)))


def consistent(matches: Correspondences, T: Float64, epsilon: float) -> Correspondences:
    """Equation 8: C_geo^in = {p, q in C_geo : |T p - q| <= epsilon}."""
    return matches.select(distances(T, matches) <= epsilon)


def surviving(
    matches: Correspondences, prior: TransformPrior, config: Config
) -> Correspondences | None:
    """Equation 8, or None if almost no match survives it.

    That is fewer than ``glue.min_credible``, or fewer than ``glue.over_chance`` times those
    expected to survive if points were matched at random, as under any transform.
    """
    survivors = consistent(matches, prior.T_target_source, prior.radius)
    order = np.random.default_rng(config.seed).permutation(len(matches))
    at_random = Correspondences(matches.source, matches.target[order], matches.weights)
    by_chance = len(consistent(at_random, prior.T_target_source, prior.radius))
    least = max(config.glue.min_credible, config.glue.over_chance * by_chance)
    return survivors if len(survivors) >= least else None


def geometric_rough(matches: Correspondences, config: Config) -> TransformPrior | None:
    """A rough transform by SC2-PCR of geometric matches alone, with epsilon as in 4 to 7."""
    T, agreeing = sc2_pcr(matches)
    if T is None or agreeing < config.glue.min_credible:
        return None
    glue = config.glue
    inliers = matches.select(distances(T, matches) <= INLIER_M)
    return TransformPrior(T, adaptive_threshold(error_variance(inliers, T), glue.confidence))


@dataclass(frozen=True)
class _RoughTransform:
    """The result of visual matches, before geometric ones are considered.

    Attributes:
        inliers: C_vis^in, equation 4.
        sigma_m: sigma-hat of equation 5, metres; NaN if there is none.
        prior: the rough transform and epsilon of equation 7; None if there is none.
    """

    inliers: Correspondences
    sigma_m: float
    prior: TransformPrior | None


@dataclass(frozen=True)
class _GeometricMatches:
    """Geometric matches before and after the filter.

    Attributes:
        matches: C_geo.
        credible: C_geo^in of equation 8; None if the filter was skipped.
    """

    matches: Correspondences
    credible: Correspondences | None


class Glue:
    """Registers RGB-D frames with the features and parameters of a configuration.

    Attributes:
        visual: the configured visual features.
        geometric: the configured geometric features.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self.visual = VISUAL[config.features.visual](config.features)
        self.geometric = GEOMETRIC[config.features.geometric](config.features)

    @property
    def inlier_threshold(self) -> float:
        """t_in, the maximum distance at which a visual match agrees with a transform, metres."""
        return self._config.glue.inlier_threshold

    def reconfigure(self, config: Config) -> None:
        """Sets other parameters, with the same features."""
        self._config = config

    def extract(self, view: View) -> FrameFeatures:
        """Section 3.1: visual and geometric features."""
        return self.extract_visual(view, partial(self.extract_geometric, view)).complete()

    def extract_visual(
        self, view: View, timed_geometric: Callable[[], tuple[Any, float]]
    ) -> FeaturesInProgress:
        """Section 3.1, with geometric features from elsewhere, such as another thread.

        Args:
            view: the frame.
            timed_geometric: gives the result of ``extract_geometric``, maybe after waiting for it.
        """
        return FeaturesInProgress(view, timed(self.visual.extract, view), timed_geometric)

    def extract_geometric(self, view: View) -> tuple[Any, float]:
        """Geometric features, and the milliseconds that they took."""
        return timed(self.geometric.extract, view)

    def with_other_depth(self, features: FrameFeatures, view: View) -> FrameFeatures:
        """The features of a view with the same colours, but other depth or velocity."""
        return replace(features, view=view, geometric=self.geometric.extract(view))

    def without_images(self, features: FrameFeatures) -> Described:
        """What registration needs of a frame, with depth at its keypoints alone.

        Visual features that may match any pixel need the images too: theirs are unchanged.
        """
        if not isinstance(self.visual, KeypointFeature):
            return features
        points = KeypointPoints.of(self.visual.keypoints(features.visual), features.view)
        return KeypointFeatures(features.visual, features.geometric, points)

    def register(
        self, source: Described, target: Described, prior: TransformPrior | None = None
    ) -> RegistrationResult:
        """The transform T_target_source of two frames (sections 3.1 to 3.3).

        Args:
            source: frame whose points are p.
            target: frame whose points are q.
            prior: a transform to search around if visual matches give none; None for the paper's
                method, which then skips the filter.

        Returns:
            The result; its status says why if there is no transform.

        Raises:
            InputError: the matches of a visual feature of one's own have not one row each.
        """
        rng = np.random.default_rng(self._config.seed)
        clock = Stopwatch()

        C_vis = self._visual_matches(source, target)
        clock.lap(stages.VISUAL_MATCHING)
        rough = self._rough_transform(C_vis, prior, rng)
        clock.lap(stages.RANSAC)
        geometric = self._filtered(source, target, rough.prior)
        clock.lap(stages.GEOMETRIC_MATCHING)
        if geometric.credible is None and self.has_fallback:
            rough, geometric = self._fall_back(source, target, C_vis, rough, geometric)
            clock.lap(stages.FALLBACK)

        C_geo_in = geometric.matches if geometric.credible is None else geometric.credible
        C = rough.inliers + C_geo_in
        can_be_fitted = len(C) >= self._config.glue.min_visual and C.weights.any()
        T = FITS[self._config.fit.method](C, self._config, rng) if can_be_fitted else None
        covariance = None if T is None else fit_covariance(T, C)
        clock.lap(stages.FIT)

        filtered = geometric.credible is not None
        unfitted = RegistrationResult(
            T_target_source=None,
            status=RegistrationStatus.TOO_FEW_CORRESPONDENCES,
            visual=C_vis,
            visual_inliers=rough.inliers,
            geometric=geometric.matches,
            credible=C_geo_in,
            filtered=filtered,
            sigma_m=rough.sigma_m,
            epsilon_m=rough.prior.radius if filtered and rough.prior else float("nan"),
            stages_ms=clock.laps_ms,
        )
        if not can_be_fitted:
            return unfitted
        if T is None or covariance is None:
            return unfitted.refused(RegistrationStatus.DEGENERATE)
        return unfitted.accepted(T, covariance)

    def visual_inliers(self, source: Described, target: Described) -> Correspondences:
        """C_vis^in, without what follows in ``register``: that takes many times as long.

        Raises:
            InputError: as by ``register``.
        """
        rng = np.random.default_rng(self._config.seed)
        return self._rough_transform(self._visual_matches(source, target), None, rng).inliers

    @property
    def has_fallback(self) -> bool:
        """Whether geometric matches alone may give a rough transform if visual ones do not."""
        return self._config.glue.filter and self._config.glue.fallback == SC2_PCR

    def _visual_matches(self, source: Described, target: Described) -> Correspondences:
        """C_vis."""
        matches = self.visual.match(source.visual, target.visual)
        check_matches(matches, self._config.features.visual)
        return lift(matches, source.points_at, target.points_at)

    def _rough_transform(
        self, C_vis: Correspondences, prior: TransformPrior | None, rng: np.random.Generator
    ) -> _RoughTransform:
        """Section 3.2 with equations 4 to 7; the prior if there are too few visual matches."""
        glue, ransac_config = self._config.glue, self._config.ransac
        T, agreeing = ransac(C_vis, glue.inlier_threshold, ransac_config.iterations, rng)
        if T is None or agreeing < ransac_config.min_inliers:
            return _RoughTransform(Correspondences.empty(), float("nan"), prior)
        C_vis_in = self._assumed_inliers(C_vis, T)
        if len(C_vis_in) < glue.min_visual:
            return _RoughTransform(C_vis_in, float("nan"), prior)
        variance = error_variance(C_vis_in, T)
        epsilon = adaptive_threshold(variance, glue.confidence)
        return _RoughTransform(C_vis_in, float(np.sqrt(variance)), TransformPrior(T, epsilon))

    def _assumed_inliers(self, C_vis: Correspondences, T: Float64) -> Correspondences:
        """Equation 4 with t_in and K of the configuration."""
        return assumed_inliers(C_vis, T, self.inlier_threshold, self._config.k)

    def _filtered(
        self, source: Described, target: Described, prior: TransformPrior | None
    ) -> _GeometricMatches:
        """C_geo, and what equation 8 leaves of it if the filter is on and has a transform."""
        guide = prior if self._config.glue.filter else None
        C_geo = self.geometric.match(source.geometric, target.geometric, guide)
        credible = None if guide is None else surviving(C_geo, guide, self._config)
        return _GeometricMatches(C_geo, credible)

    def _fall_back(
        self,
        source: Described,
        target: Described,
        C_vis: Correspondences,
        rough: _RoughTransform,
        geometric: _GeometricMatches,
    ) -> tuple[_RoughTransform, _GeometricMatches]:
        """Filters by a transform from geometric matches alone; unchanged if there is none."""
        unguided = geometric.matches
        if rough.prior is not None:
            unguided = self.geometric.match(source.geometric, target.geometric, None)
        prior = geometric_rough(unguided, self._config)
        if prior is None:
            return rough, geometric
        C_vis_in = self._assumed_inliers(C_vis, prior.T_target_source)
        return (
            _RoughTransform(C_vis_in, float("nan"), prior),
            self._filtered(source, target, prior),
        )
