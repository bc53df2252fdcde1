"""When the rows of an image were read, and where points were at another time.

A moving camera reads each row of a rolling shutter at another place, and takes late depth at
another place than colour. Points are moved to where the camera saw them when the middle row of the
colour image was read.
"""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import back_project
from rgbd_glue_ros.geometry.depth import sample_depth
from rgbd_glue_ros.types import Float32, Float64, Int64, Mask, View


def normalised_row_time(rows: Float32 | Float64 | Int64, view: View) -> Float64:
    """When a rolling shutter reads rows [N], as a fraction of its readout: 0 at the middle row."""
    return np.asarray(rows / view.intrinsics.height - 0.5, np.float64)


def camera_velocity_at(points: Float64, twist: Float64) -> Float64:
    """The velocity v + omega x p, m/s, of points [N, 3] that are fixed to the camera.

    A camera that moves with ``twist`` [6] sees points of a static room pass by with the opposite.
    """
    velocity: Float64 = twist[:3] + points @ se3.skew(twist[3:]).T
    return velocity


def displaced_points(points: Float64, seconds: Float64, twist: Float64) -> Float64:
    """Points where a camera moving with ``twist`` saw them some seconds earlier.

    Args:
        points: float64 [..., 3], metres.
        seconds: for each of them, float64 [...], or what broadcasts to it.
        twist: float64 [6], linear and angular velocity in the optical frame.
    """
    moved: Float64 = points + seconds[..., np.newaxis] * camera_velocity_at(points, twist)
    return moved


@compiled
def displaced_point(
    x: float, y: float, z: float, seconds: float, twist: Float64 | tuple[float, ...]
) -> tuple[float, float, float]:
    """``displaced_points`` for one point."""
    return (
        x + seconds * (twist[0] + twist[4] * z - twist[5] * y),
        y + seconds * (twist[1] + twist[5] * x - twist[3] * z),
        z + seconds * (twist[2] + twist[3] * y - twist[4] * x),
    )


def seconds_after_color(rows: Int64, view: View) -> Float64:
    """When the rows [N] of the depth image were read, relative to the middle row of colour."""
    seconds: Float64 = view.depth_delay + view.readout_time * normalised_row_time(rows, view)
    return seconds


def keypoints_to_points(uv: Float32, view: View) -> tuple[Float64, Mask]:
    """Pixels of the colour image as points, where their depth is known.

    Args:
        uv: float32 [N, 2].
        view: the frame.

    Returns:
        Points [M, 3] as seen when the middle row is read, and which pixels [N] have one.
    """
    motion = view.twist * view.depth_delay
    K = view.intrinsics.focal_and_centre
    z = _delayed_depth_at(view.depth, uv, K, motion, view.depth_noise)
    known = np.isfinite(z)
    points = back_project(uv[known], z[known], view.intrinsics)
    return displaced_points(
        points, view.readout_time * normalised_row_time(uv[known, 1], view), view.twist
    ), known


@compiled
def _delayed_depth_at(
    depth: Float32, uv: Float32, K: Float64, motion: Float64, noise: float
) -> Float64:
    """Depth [N] at pixels uv [N, 2] of an image taken before the camera moved by ``motion`` [6]."""
    depths = np.empty(len(uv))
    for i in range(len(uv)):
        rx, ry = (uv[i, 0] - K[2]) / K[0], (uv[i, 1] - K[3]) / K[1]
        z = sample_depth(depth, uv[i, 0], uv[i, 1], noise)
        # which depth pixel corresponds depends on the depth itself
        for _ in range(2):
            x, y, later = displaced_point(rx * z, ry * z, z, -1.0, motion)
            if not later > 0.0:
                z = np.nan
                break
            column, row = K[0] * x / later + K[2], K[1] * y / later + K[3]
            measured = sample_depth(depth, column, row, noise)
            _, _, z = displaced_point(
                x / later * measured, y / later * measured, measured, 1.0, motion
            )
        depths[i] = z
    return depths
