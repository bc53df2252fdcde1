"""Joint refinement of a pose on sub-pixel tracks and on planes, after the fit of the paper.

Tracks drift where texture is weak and planes slide where geometry is; together they do neither.
The residuals are those of visual odometry (reprojection, pixels) and of projective point-to-plane
ICP (Chen and Medioni 1992, Newcombe et al. 2011) divided by the depth noise, both with Cauchy
weights, minimised by Gauss-Newton.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from rgbd_glue_ros.camera import depth_sigma, sample_depth
from rgbd_glue_ros.config import RefineConfig
from rgbd_glue_ros.se3 import exp
from rgbd_glue_ros.types import CameraIntrinsics, Float32, Float64

# Blur of depth edges and lens: a depth belongs to a pixel only to about this accuracy.
_LATERAL_SIGMA_PX = 0.5
# Farther than this many sigma apart, a plane and a depth are not the same surface.
_PLANE_GATE_SIGMAS = 10.0
_CONVERGED_M = 2e-5


@dataclass(frozen=True)
class Planes:
    """Oriented points of the model, in the model's frame.

    Attributes:
        points: float64 [M, 3], metres.
        normals: float64 [M, 3], unit.
    """

    points: Float64
    normals: Float64


@dataclass(frozen=True)
class Tracks:
    """Landmarks of the model seen in the source image.

    Attributes:
        points: float64 [N, 3] in the model's frame, metres.
        uv: float64 [N, 2], where the source camera sees them, pixels.
    """

    points: Float64
    uv: Float64


@dataclass(frozen=True)
class Refinement:
    """What the joint refinement found.

    Attributes:
        T_model_source: float64 [4, 4].
        information: float64 [6, 6] of the last Gauss-Newton step, perturbation on the left.
        tracks: tracks that agree with the pose.
        planes: planes that agree with the depth image.
        planes_seen: planes that project onto known depth, agreeing or not.
        planes_behind: planes that the source sees through, which no occlusion explains.
    """

    T_model_source: Float64
    information: Float64
    tracks: int
    planes: int
    planes_seen: int
    planes_behind: int


def refine(
    T_model_source: Float64,
    planes: Planes,
    tracks: Tracks,
    depth: Float32,
    intrinsics: CameraIntrinsics,
    config: RefineConfig,
) -> Refinement:
    """Gauss-Newton on tracks and planes from a starting pose.

    Args:
        T_model_source: start, float64 [4, 4].
        planes: of the model.
        tracks: of the model's landmarks in the source image.
        depth: of the source, float32 [H, W], metres, NaN where unknown.
        intrinsics: of the source.
        config: iterations and weights.

    Returns:
        The refined pose and how well the model agrees with it.
    """
    K = np.array([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy])
    T = T_model_source
    H, counts = np.eye(6), np.zeros(4, np.int64)
    for _ in range(config.iterations):
        H, g = np.zeros((6, 6)), np.zeros(6)
        agreeing, seen, behind = _add_planes(
            T, planes.points, planes.normals, depth, K, config.plane_cauchy, H, g
        )
        kept = _add_tracks(
            T, tracks.points, tracks.uv, K, config.track_weight, config.track_cauchy, H, g
        )
        counts[:] = kept, agreeing, seen, behind
        # a whisper of damping keeps an unseen direction where the start put it
        step = np.linalg.solve(H + 1e-3 * np.eye(6), -g)
        T = exp(step) @ T
        if np.abs(step).max() < _CONVERGED_M:
            break
    return Refinement(T, H, *(int(n) for n in counts))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _add_planes(
    T: Float64,
    points: Float64,
    normals: Float64,
    depth: Float32,
    K: Float64,
    cauchy: float,
    H: Float64,
    g: Float64,
) -> tuple[int, int, int]:
    """Adds the point-to-plane terms of a linearisation at T to H and g."""
    R, t = T[:3, :3], T[:3, 3]
    agreeing, seen, behind = 0, 0, 0
    J = np.empty(6)
    for i in range(len(points)):
        d0, d1, d2 = points[i, 0] - t[0], points[i, 1] - t[1], points[i, 2] - t[2]
        z = R[0, 2] * d0 + R[1, 2] * d1 + R[2, 2] * d2
        if z < 0.05:
            continue
        rx = (R[0, 0] * d0 + R[1, 0] * d1 + R[2, 0] * d2) / z
        ry = (R[0, 1] * d0 + R[1, 1] * d1 + R[2, 1] * d2) / z
        measured = sample_depth(depth, K[0] * rx + K[2], K[1] * ry + K[3])
        if not measured > 0.0:
            continue
        seen += 1
        n0, n1, n2 = normals[i, 0], normals[i, 1], normals[i, 2]
        # the measured point, in the model's frame
        x, y = rx * measured, ry * measured
        q0 = R[0, 0] * x + R[0, 1] * y + R[0, 2] * measured + t[0]
        q1 = R[1, 0] * x + R[1, 1] * y + R[1, 2] * measured + t[1]
        q2 = R[2, 0] * x + R[2, 1] * y + R[2, 2] * measured + t[2]
        r = n0 * (q0 - points[i, 0]) + n1 * (q1 - points[i, 1]) + n2 * (q2 - points[i, 2])
        # depth noise along the ray and lateral blur, both seen along the normal
        nx = R[0, 0] * n0 + R[1, 0] * n1 + R[2, 0] * n2
        ny = R[0, 1] * n0 + R[1, 1] * n1 + R[2, 1] * n2
        nz = R[0, 2] * n0 + R[1, 2] * n1 + R[2, 2] * n2
        along = depth_sigma(measured) * (nx * rx + ny * ry + nz)
        lateral = _LATERAL_SIGMA_PX * measured / K[0]
        variance = along * along + lateral * lateral * (nx * nx + ny * ny)
        squared = r * r / variance
        if squared > _PLANE_GATE_SIGMAS**2:
            if measured > z + _PLANE_GATE_SIGMAS * depth_sigma(z):
                behind += 1
            continue
        if squared < 9.0:
            agreeing += 1
        w = 1.0 / (variance * (1.0 + squared / (cauchy * cauchy)))
        J[0], J[1], J[2] = n0, n1, n2
        J[3], J[4], J[5] = q1 * n2 - q2 * n1, q2 * n0 - q0 * n2, q0 * n1 - q1 * n0
        for a in range(6):
            g[a] += w * r * J[a]
            for b in range(6):
                H[a, b] += w * J[a] * J[b]
    return agreeing, seen, behind


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _add_tracks(
    T: Float64,
    points: Float64,
    uv: Float64,
    K: Float64,
    weight: float,
    cauchy: float,
    H: Float64,
    g: Float64,
) -> int:
    """Adds the reprojection terms of a linearisation at T to H and g."""
    R, t = T[:3, :3], T[:3, 3]
    agreeing = 0
    J = np.empty((2, 6))
    for i in range(len(points)):
        X0, X1, X2 = points[i, 0], points[i, 1], points[i, 2]
        d0, d1, d2 = X0 - t[0], X1 - t[1], X2 - t[2]
        x = R[0, 0] * d0 + R[1, 0] * d1 + R[2, 0] * d2
        y = R[0, 1] * d0 + R[1, 1] * d1 + R[2, 1] * d2
        z = R[0, 2] * d0 + R[1, 2] * d1 + R[2, 2] * d2
        if z < 0.05:
            continue
        ru = K[0] * x / z + K[2] - uv[i, 0]
        rv = K[1] * y / z + K[3] - uv[i, 1]
        squared = (ru * ru + rv * rv) / (cauchy * cauchy)
        if squared < 9.0:
            agreeing += 1
        w = weight / (1.0 + squared)
        # the point moves by -R^T (v + omega x X) in the camera, for a left perturbation of T
        for a in range(3):
            J[0, a] = -(K[0] / z) * (R[a, 0] - x / z * R[a, 2])
            J[1, a] = -(K[1] / z) * (R[a, 1] - y / z * R[a, 2])
        for k in range(2):
            J[k, 3] = X1 * J[k, 2] - X2 * J[k, 1]
            J[k, 4] = X2 * J[k, 0] - X0 * J[k, 2]
            J[k, 5] = X0 * J[k, 1] - X1 * J[k, 0]
        for a in range(6):
            g[a] += w * (J[0, a] * ru + J[1, a] * rv)
            for b in range(6):
                H[a, b] += w * (J[0, a] * J[0, b] + J[1, a] * J[1, b])
    return agreeing
