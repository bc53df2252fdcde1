"""Whether an error is consistent with its covariance: Mahalanobis distances and their gates."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.special import chdtri

from rgbd_glue_ros.types import Float64


@lru_cache
def chi_squared(confidence: float, degrees: int) -> float:
    """The quantile of chi² for a number of degrees of freedom and a probability."""
    # scipy.stats offers it under this name, but takes half a second to import
    return float(chdtri(degrees, 1.0 - confidence))


POSE_GATE = chi_squared(0.999, 6)
"""The validation gate of a pose: a squared Mahalanobis distance that one in a thousand exceeds."""


def mahalanobis_squared(error: Float64, covariance: Float64) -> float:
    """The square of an error [N] by its covariance [N, N]; its mean is N if that is consistent."""
    return float(error @ np.linalg.solve(covariance, error))
