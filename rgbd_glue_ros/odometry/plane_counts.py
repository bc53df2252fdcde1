"""Whether planes tell two poses of a frame apart, or agree with either by chance.

Depth noisier than expected contradicts every pose with a tenth of its planes. A wall agrees with
any pose along it, but for that noise: so of the planes that contradict one pose, nine tenths agree
with another one, as if they followed it. But so do nine tenths of all others.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.refinement.level_problem import LevelProblem
from rgbd_glue_ros.refinement.residuals import AGREEING_SIGMAS, plane_variances, visible_planes
from rgbd_glue_ros.types import Float64

# What exceeds its standard deviation by this factor is not chance.
_SIGNIFICANT_SIGMAS = 3.0
# Neighbouring planes are fitted to overlapping windows, and stereo cameras match windows: so many
# planes count as one.
_PLANES_PER_INDEPENDENT_ONE = 3.0


@dataclass(frozen=True)
class PlaneCounts:
    """Planes that two poses would displace by more than noise, by which of them they agree with.

    Attributes:
        both: number of planes that agree with both: it is their normals that are wrong.
        alone: number of planes that agree with the first pose only.
        other_alone: number of planes that agree with the other pose only.
        neither: number of planes that agree with none.
    """

    both: int
    alone: int
    other_alone: int
    neither: int

    @staticmethod
    def of(T: Float64, T_other: Float64, of_level: LevelProblem) -> PlaneCounts:
        """Counts the planes that are visible at both poses.

        Args:
            T: the first pose, float64 [4, 4].
            T_other: the other one.
            of_level: the planes and the frame.
        """
        visible, agrees = visible_planes(T, of_level)
        visible_at_other, agrees_with_other = visible_planes(T_other, of_level)
        tells = _sigmas_apart(T, T_other, of_level) > AGREEING_SIGMAS
        counted = tells & visible & visible_at_other
        agrees, agrees_with_other = agrees[counted], agrees_with_other[counted]
        return PlaneCounts(
            both=int(np.count_nonzero(agrees & agrees_with_other)),
            alone=int(np.count_nonzero(agrees & ~agrees_with_other)),
            other_alone=int(np.count_nonzero(~agrees & agrees_with_other)),
            neither=int(np.count_nonzero(~agrees & ~agrees_with_other)),
        )

    @property
    def sigmas_of_part(self) -> float:
        """By how much more often planes agree with the first pose if they contradict the other.

        This is the difference of two proportions, in standard deviations: the root of Pearson's
        chi-squared. Noise makes it 0.
        """
        both, alone, other_alone, neither = self.both, self.alone, self.other_alone, self.neither
        margins = (
            (alone + neither) * (both + other_alone) * (both + alone) * (other_alone + neither)
        )
        total = both + alone + other_alone + neither
        return (alone * other_alone - both * neither) * sqrt(total / max(margins, 1))

    @property
    def sigmas_of_majority(self) -> float:
        """By how many more planes agree with the first pose only, in standard deviations.

        This is the root of McNemar's chi-squared. Noise makes it 0.
        """
        either = self.alone + self.other_alone
        return (self.alone - self.other_alone) / sqrt(max(either, 1))

    @property
    def are_for_first(self) -> bool:
        """Whether more planes are for the first pose than chance would make of them.

        Either a part of the view follows it, or the other pose is wrong. In noise these are
        independent of each other.
        """
        sigmas = hypot(max(self.sigmas_of_part, 0.0), max(self.sigmas_of_majority, 0.0))
        return sigmas > _SIGNIFICANT_SIGMAS * sqrt(_PLANES_PER_INDEPENDENT_ONE)


def _sigmas_apart(T: Float64, T_other: Float64, of_level: LevelProblem) -> Float64:
    """How far two poses displace planes along their normals, in standard deviations [N].

    Along itself a plane agrees with any pose.
    """
    T_camera = se3.inverse(T_other)
    points, normals = of_level.points.T, of_level.normals.T
    moved = se3.transform(T @ T_camera, points) - points
    variances = plane_variances(
        normals @ T_camera[:3, :3].T,
        se3.transform(T_camera, points),
        of_level.depth_exposure.K[0],
        of_level.depth_noise,
    )
    apart: Float64 = np.abs((normals * moved).sum(axis=1)) / np.sqrt(variances)
    return apart
