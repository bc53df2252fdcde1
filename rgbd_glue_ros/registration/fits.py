"""The ways to fit a transform to the correspondences C = C_vis^in ∪ C_geo^in (section 3.3)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rgbd_glue_ros.geometry.fitting import procrustes, randomised_procrustes, ransac
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.types import Correspondences, Float64

Fit = Callable[[Correspondences, Config, np.random.Generator], Float64 | None]
"""Gives T_target_source [4, 4] of C, or None if there is none."""


def randomised_fit(C: Correspondences, config: Config, rng: np.random.Generator) -> Float64 | None:
    """The best of weighted Procrustes fits to random subsets of C, as the paper has it."""
    return randomised_procrustes(C, config.fit.subsets, config.fit.fraction, rng)


def procrustes_fit(C: Correspondences, _: Config, __: np.random.Generator) -> Float64 | None:
    """One weighted Procrustes fit to all of C (equation 10)."""
    return procrustes(C.source, C.target, C.weights)


def ransac_fit(C: Correspondences, config: Config, rng: np.random.Generator) -> Float64 | None:
    """RANSAC on C with the threshold t_in, without weights."""
    T, _ = ransac(C, config.glue.inlier_threshold, config.ransac.iterations, rng)
    return T


FITS: dict[str, Fit] = {
    "randomised": randomised_fit,
    "procrustes": procrustes_fit,
    "ransac": ransac_fit,
}
"""The choices of ``fit.method``."""
