"""Where and when an image of a frame shows the points of a model.

This and the residuals are loops without branches over arrays of one coordinate each: the compiler
then computes several points at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rgbd_glue_ros.compiled import compiled, inlined
from rgbd_glue_ros.geometry.motion_compensation import displaced_point
from rgbd_glue_ros.refinement.level_problem import Exposure
from rgbd_glue_ros.types import Float64

# Points nearer than this are not visible.
NEAREST_M = 0.05


class Projection(NamedTuple):
    """Points as an image shows them.

    Attributes:
        u: float64 [N], column; NaN for a point that the camera does not face.
        v: float64 [N], row.
        z: float64 [N], distance along the optical axis when that row is read, metres.
        row_time: float64 [N], normalised time of the row.
    """

    u: Float64
    v: Float64
    z: Float64
    row_time: Float64


@inlined
def as_numbers(T: Float64) -> tuple[tuple[float, ...], ...]:
    """Rotation and translation [3, 4] of a transform [4, 4] as numbers.

    The compiler need not read numbers again in every step of a loop that writes to arrays.
    """
    return (
        (T[0, 0], T[0, 1], T[0, 2], T[0, 3]),
        (T[1, 0], T[1, 1], T[1, 2], T[1, 3]),
        (T[2, 0], T[2, 1], T[2, 2], T[2, 3]),
    )


@compiled
def project(T_model_camera: Float64, points: Float64, exposure: Exposure) -> Projection:
    """Projects points, each at the time when its row is read.

    Args:
        T_model_camera: when the middle row of the colour image is read, float64 [4, 4].
        points: float64 [3, N], in the model's frame.
        exposure: of the image.
    """
    T = as_numbers(T_model_camera)
    (fx, fy, cx, cy), height, twist, readout_time, delay = exposure
    X, Y, Z = points[0], points[1], points[2]
    size = len(X)
    u, v, z, row_time = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    for i in range(size):
        d0, d1, d2 = X[i] - T[0][3], Y[i] - T[1][3], Z[i] - T[2][3]
        x0 = T[0][0] * d0 + T[1][0] * d1 + T[2][0] * d2
        y0 = T[0][1] * d0 + T[1][1] * d1 + T[2][1] * d2
        z0 = T[0][2] * d0 + T[1][2] * d1 + T[2][2] * d2
        # row and time depend on each other; two iterations converge to a hundredth of a pixel
        time = (fy * y0 / z0 + cy) / height - 0.5
        _, y1, z1 = displaced_point(x0, y0, z0, -(delay + time * readout_time), twist)
        time = (fy * y1 / z1 + cy) / height - 0.5
        x2, y2, z2 = displaced_point(x0, y0, z0, -(delay + time * readout_time), twist)
        is_in_front = (z0 >= NEAREST_M) & (z1 >= NEAREST_M) & (z2 >= NEAREST_M)
        u[i] = fx * x2 / z2 + cx if is_in_front else np.nan
        v[i] = fy * y2 / z2 + cy
        z[i], row_time[i] = z2, time
    return Projection(u, v, z, row_time)
