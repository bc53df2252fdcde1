"""The reprojection errors of visual matches at a pose.

Planes do not constrain motion along themselves, and pixels do not help where texture is fine or
seen at a grazing angle. There the visual matches of RGBD-Glue hold the pose.
"""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.refinement.level_problem import LevelProblem
from rgbd_glue_ros.refinement.normal_equations import mirror_upper_triangle
from rgbd_glue_ros.refinement.projection import NEAREST_M
from rgbd_glue_ros.refinement.residuals import by_rotation
from rgbd_glue_ros.types import Float64

# Standard deviation of keypoint positions, coarse octaves included, pixels.
_SIGMA_PX = 1.0
# The residual, in standard deviations, at which a match's weight is halved.
_CAUCHY = 2.0


@compiled
def add_matches(T: Float64, problem: LevelProblem, H: Float64, g: Float64) -> None:
    """Adds the terms of the matches at T to g [6] and to the upper triangle of H [6, 6]."""
    source, target = problem.match_source, problem.match_target
    K, weight = problem.depth_exposure.K, problem.match_weight
    for i in range(len(source)):
        q0, q1, q2 = target[i, 0], target[i, 1], target[i, 2]
        d0, d1, d2 = q0 - T[0, 3], q1 - T[1, 3], q2 - T[2, 3]
        z = T[0, 2] * d0 + T[1, 2] * d1 + T[2, 2] * d2
        if z < NEAREST_M:
            continue
        x = (T[0, 0] * d0 + T[1, 0] * d1 + T[2, 0] * d2) / z
        y = (T[0, 1] * d0 + T[1, 1] * d1 + T[2, 1] * d2) / z
        u = K[0] * (x - source[i, 0] / source[i, 2])
        v = K[1] * (y - source[i, 1] / source[i, 2])
        squared = (u * u + v * v) / _SIGMA_PX**2
        w = weight / (_SIGMA_PX**2 * (1.0 + squared / _CAUCHY**2))
        for axis, scale, slope, r in ((0, K[0] / z, x, u), (1, K[1] / z, y, v)):
            # the point moves by -R^T (v + omega x q) in the camera
            J0 = -scale * (T[0, axis] - slope * T[0, 2])
            J1 = -scale * (T[1, axis] - slope * T[1, 2])
            J2 = -scale * (T[2, axis] - slope * T[2, 2])
            J3, J4, J5 = by_rotation(q0, q1, q2, J0, J1, J2)
            J = (J0, J1, J2, J3, J4, J5)
            for a in range(6):
                g[a] += w * r * J[a]
                for b in range(a, 6):
                    H[a, b] += w * J[a] * J[b]


def match_information(T: Float64, problem: LevelProblem) -> Float64:
    """The information of the matches at T, float64 [6, 6], perturbation on the left."""
    H = np.zeros((6, 6))
    add_matches(T, problem, H, np.zeros(6))
    mirror_upper_triangle(H)
    return H
