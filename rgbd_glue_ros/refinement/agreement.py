"""How many residuals count as one independent one, from how well parts of an image agree on a pose.

If thousands of residuals were independent, a pose would be accurate to micrometres. They are not: a
slightly wrong lens model or registration, or noise that neighbours share, shifts whole parts of
the image together. Each part then has its own optimum. How far these optima lie apart, relative to
the covariance that their residuals imply, tells how many residuals count as one (Cochran's Q of a
meta-analysis).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log

import numpy as np

from rgbd_glue_ros.refinement.normal_equations import DAMPING, damped, normal_equations
from rgbd_glue_ros.refinement.residual_rows import Rows
from rgbd_glue_ros.types import Float64

# Bands of image rows: each usually sees enough of the scene to determine a pose.
_BANDS = 3
# Frames that the mean is taken over; a camera's errors change slowly, with the scene.
_MEMORY = 30
# The configured value counts as much as this many frames.
_EXPECTATION = 1
# Errors that all bands share, such as those of the model, cause no disagreement. Their squares are
# this many times those that do, over all sequences of docs/benchmarks.md.
_IN_COMMON = 50.0


@dataclass(frozen=True)
class BandAgreement:
    """How well the bands of a camera's images agree, over the frames so far.

    Attributes:
        frames: number of frames, at most ``_MEMORY``.
        log_excess: mean logarithm of their Q per degree of freedom.
    """

    frames: int = 0
    log_excess: float = 0.0

    def residuals_per_independent_one(self, expected: float) -> float:
        """How many residuals count as one; ``expected`` before the first frame."""
        seen = self.frames / (self.frames + _EXPECTATION)
        return exp(seen * (log(_IN_COMMON) + self.log_excess) + (1 - seen) * log(expected))

    def after_frame(self, rows: Sequence[Rows]) -> BandAgreement:
        """The agreement, updated with a frame's residuals at its pose, of several kinds."""
        excess = disagreement(rows)
        if excess is None:
            return self
        frames = min(self.frames + 1, _MEMORY)
        change = (log(max(excess, 1.0)) - self.log_excess) / frames
        return BandAgreement(frames, self.log_excess + change)


def disagreement(rows: Sequence[Rows]) -> float | None:
    """Q per degree of freedom of the optima of bands of rows; None if fewer than two have one.

    Its mean is 1 if the errors of residuals are independent, with the assumed standard deviations.

    Args:
        rows: residuals at one pose, of several kinds.
    """
    bands = [_of_band(rows, band) for band in range(_BANDS)]
    # a band that leaves a direction undetermined has no optimum
    known = [(H, g) for H, g in bands if np.linalg.eigvalsh(H)[0] > DAMPING]
    if len(known) < 2:
        return None
    apart = sum(_explained(H, g) for H, g in known)
    together = _explained(*(np.sum(terms, axis=0) for terms in zip(*known, strict=True)))
    return float(apart - together) / (6 * (len(known) - 1))


def _of_band(rows: Sequence[Rows], band: int) -> tuple[Float64, Float64]:
    """Hessian [6, 6] and gradient [6] of a band."""
    H, g = np.zeros((6, 6)), np.zeros(6)
    for of_kind in rows:
        # normalised row time is -1/2 at the first row and 1/2 at the last
        inside = np.floor(_BANDS * (of_kind.row_time + 0.5)).clip(0, _BANDS - 1) == band
        H_kind, g_kind = normal_equations(
            of_kind.jacobian[inside], of_kind.weight[inside], of_kind.residual[inside]
        )
        H, g = H + H_kind, g + g_kind
    return H, g


def _explained(H: Float64, g: Float64) -> float:
    """By how much the optimum of these terms lowers the squared residuals."""
    return float(g @ np.linalg.solve(damped(H), g))
