"""Matches between two frames, and the transform between them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from rgbd_glue_ros.types.arrays import Float64, Int64, Mask


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Matched 3D points, one row per match.

    Attributes:
        source: float64 [N, 3], points p in the source camera's optical frame, metres.
        target: float64 [N, 3], points q in the target camera's optical frame, metres.
        weights: float64 [N], w of equation 10, not negative.
    """

    source: Float64
    target: Float64
    weights: Float64

    def __len__(self) -> int:
        return len(self.weights)

    def select(self, rows: Mask | Int64) -> Correspondences:
        """The matches at ``rows`` (a mask [N] or indices)."""
        return Correspondences(self.source[rows], self.target[rows], self.weights[rows])

    def __add__(self, other: Correspondences) -> Correspondences:
        """The union of two disjoint sets (equation 9)."""
        return Correspondences(
            np.concatenate([self.source, other.source]),
            np.concatenate([self.target, other.target]),
            np.concatenate([self.weights, other.weights]),
        )

    def moved_target(self, T: Float64) -> Correspondences:
        """The matches with their targets in the frame that T [4, 4] maps to."""
        return replace(self, target=self.target @ T[:3, :3].T + T[:3, 3])

    @staticmethod
    def empty() -> Correspondences:
        """No matches."""
        return Correspondences(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))


@dataclass(frozen=True)
class TransformPrior:
    """A rough transform and how far a correct match may deviate from it.

    Attributes:
        T_target_source: float64 [4, 4].
        radius: epsilon, metres.
    """

    T_target_source: Float64
    radius: float


class RegistrationStatus(Enum):
    """Whether a registration gave a transform, and if not, why."""

    OK = "ok"
    TOO_FEW_CORRESPONDENCES = "too few correspondences"
    DEGENERATE = "the correspondences do not fix all six degrees of freedom"
    INCONSISTENT = "the transform disagrees with the depth images or the motion"


@dataclass(frozen=True, eq=False)
class RegistrationResult:
    """Result of registering a source frame against a target frame.

    Attributes:
        T_target_source: float64 [4, 4], or None unless ``status`` is OK.
        status: OK, or why there is no transform.
        visual: C_vis, lifted to 3D.
        visual_inliers: C_vis^in, equation 4.
        geometric: C_geo, before the filter.
        credible: C_geo^in, equation 8; C_geo if the filter was skipped.
        filtered: whether the consistency filter was applied (equation 8) or skipped.
        sigma_m: sigma-hat of equation 5, metres; NaN if there was none.
        epsilon_m: epsilon of equation 7, metres; NaN if the filter was skipped.
        covariance: float64 [6, 6] of T_target_source (x y z rx ry rz, perturbation on the left,
            in the target frame; m, rad), or None unless ``status`` is OK.
        stages_ms: wall time of each of ``types.stages``, milliseconds.
    """

    T_target_source: Float64 | None
    status: RegistrationStatus
    visual: Correspondences
    visual_inliers: Correspondences
    geometric: Correspondences
    credible: Correspondences
    filtered: bool = False
    sigma_m: float = float("nan")
    epsilon_m: float = float("nan")
    covariance: Float64 | None = None
    stages_ms: dict[str, float] = field(default_factory=dict)

    def accepted(self, T_target_source: Float64, covariance: Float64) -> RegistrationResult:
        """This result with a transform."""
        return replace(
            self,
            T_target_source=T_target_source,
            covariance=covariance,
            status=RegistrationStatus.OK,
        )

    def refused(self, status: RegistrationStatus) -> RegistrationResult:
        """This result without a transform, with the reason."""
        return replace(self, T_target_source=None, covariance=None, status=status)

    def with_stage(self, name: str, milliseconds: float) -> RegistrationResult:
        """This result with the wall time of an additional stage."""
        return replace(self, stages_ms={**self.stages_ms, name: milliseconds})
