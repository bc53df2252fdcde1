"""A coloured cloud of what keyframes saw, fused along a trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.features.voxels import group_means
from rgbd_glue_ros.files.writing import write_whole
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import back_project
from rgbd_glue_ros.geometry.depth import DEPTH_EDGE_SIGMAS, depth_sigmas
from rgbd_glue_ros.geometry.views import rectified
from rgbd_glue_ros.types import Float32, Float64, Int64, Mask, RgbdFrame, UInt8

VOXEL_M = 0.01
"""Points nearer to each other than this are merged."""

# Pixels between points.
_STRIDE_PX = 2
# Structured light and stereo distort walls beyond this; another keyframe sees them from nearer.
_FARTHEST_M = 4.0
# A surface may recede by this fraction of its depth from one pixel to the next.
_SLOPE = 0.03
# Bits of a voxel's index along an axis: 20 km in both directions at 1 cm.
_BITS = 21


@dataclass(frozen=True)
class ColoredCloud:
    """Points with colours.

    Attributes:
        points: float32 [N, 3], metres.
        colors: uint8 [N, 3], RGB.
    """

    points: Float32
    colors: UInt8

    def __len__(self) -> int:
        return len(self.points)


def cloud_of(frame: RgbdFrame, voxel_m: float = VOXEL_M) -> ColoredCloud:
    """The points of a frame within 4 m, in its optical frame, without depth edges.

    Pixels at an edge have a depth that belongs to neither side.
    """
    frame = rectified(frame)
    depth = frame.depth[::_STRIDE_PX, ::_STRIDE_PX]
    color = frame.color[::_STRIDE_PX, ::_STRIDE_PX]
    v, u = np.nonzero((depth > 0) & (depth < _FARTHEST_M) & ~_edges(depth))
    z = depth[v, u].astype(np.float64)
    uv = _STRIDE_PX * np.column_stack([u, v]).astype(np.float64)
    colors = color[v, u] if color.ndim == 3 else np.repeat(color[v, u, None], 3, axis=1)
    return _averaged(back_project(uv, z, frame.intrinsics), colors, voxel_m, 1)


def fused(clouds: Sequence[ColoredCloud], poses: Float64, voxel_m: float = VOXEL_M) -> ColoredCloud:
    """The clouds in one frame, one point per voxel, without voxels with a single point.

    Args:
        clouds: each in its camera's frame.
        poses: T_map_camera of each, float64 [N, 4, 4].
        voxel_m: edge of the voxels, metres.
    """
    if not clouds:
        return ColoredCloud(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8))
    points = [
        se3.transform(T, cloud.points.astype(np.float64))
        for T, cloud in zip(poses, clouds, strict=True)
    ]
    colors = np.concatenate([cloud.colors for cloud in clouds])
    least = 2 if len(clouds) > 1 else 1
    return _averaged(np.concatenate(points), colors, voxel_m, least)


def write_ply(path: Path, cloud: ColoredCloud) -> None:
    """Writes a binary PLY, which MeshLab, CloudCompare, Blender and Open3D read.

    Raises:
        InputError: the file cannot be written.
    """
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(cloud)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    rows = np.empty(len(cloud), [("points", "<f4", 3), ("colors", "u1", 3)])
    rows["points"], rows["colors"] = cloud.points, cloud.colors
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            path, f"cannot be written ({error.strerror})", "give another file"
        ) from error
    write_whole(path, header.encode("ascii") + rows.tobytes())


def _edges(depth: Float32) -> Mask:
    """Where depth [H, W] differs from a neighbour's by more than noise and slope explain."""
    allowed = np.maximum(DEPTH_EDGE_SIGMAS * depth_sigmas(depth), _SLOPE * depth)
    edge = np.zeros(depth.shape, bool)
    # down the columns, and along the rows
    for z, most, is_edge in ((depth, allowed, edge), (depth.T, allowed.T, edge.T)):
        step = np.abs(np.diff(z, axis=0))
        is_edge[1:] |= step > most[1:]
        is_edge[:-1] |= step > most[:-1]
    return edge


def _averaged(points: Float64, colors: UInt8, voxel_m: float, least: int) -> ColoredCloud:
    """The mean of each voxel that has ``least`` points."""
    _, voxel, counts = np.unique(_voxels(points, voxel_m), return_inverse=True, return_counts=True)
    kept = counts >= least
    means = group_means(np.column_stack([points, colors]), voxel)[kept]
    return ColoredCloud(means[:, :3].astype(np.float32), np.rint(means[:, 3:]).astype(np.uint8))


def _voxels(points: Float64, voxel_m: float) -> Int64:
    """A number for the voxel of each point [N, 3]."""
    cells = np.floor(points / voxel_m).astype(np.int64) + (1 << (_BITS - 1))
    numbers: Int64 = (cells[:, 0] << 2 * _BITS) | (cells[:, 1] << _BITS) | cells[:, 2]
    return numbers
