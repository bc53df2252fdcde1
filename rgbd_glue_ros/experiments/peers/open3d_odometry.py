"""Open3D's registrations of pixels and points that start from the identity."""

from __future__ import annotations

from typing import Any

import numpy as np

from rgbd_glue_ros.experiments.peers.base import NoTransformError
from rgbd_glue_ros.experiments.peers.open3d_library import grey_cloud, load_open3d
from rgbd_glue_ros.types import Float64, View

# Voxels in metres and steps of the three scales in Open3D's tutorial on coloured ICP. Its reach of
# one voxel is for a good start; from the identity that is too short.
_SCALES = ((0.04, 50), (0.02, 30), (0.01, 14))
_REACH_VOXELS = 3

# Open3D skips depth beyond 4 m by default; the frames are already limited.
_FAR_M = 100.0


class ColoredIcp:
    """Coloured ICP (Park, Zhou and Koltun 2017) on brightness, coarse to fine."""

    def __init__(self) -> None:
        self._open3d = load_open3d("colored_icp")

    def prepare(self, view: View) -> list[Any]:
        """The cloud with normals at each scale."""
        points = grey_cloud(self._open3d, view)
        scales = []
        for voxel, _ in _SCALES:
            scale = points.voxel_down_sample(voxel)
            scale.estimate_normals(
                self._open3d.geometry.KDTreeSearchParamHybrid(radius=2 * voxel, max_nn=30)
            )
            scales.append(scale)
        return scales

    def register(self, source: list[Any], target: list[Any]) -> Float64:
        """T_target_source."""
        registration = self._open3d.pipelines.registration
        T = np.eye(4)
        for (voxel, iterations), p, q in zip(_SCALES, source, target, strict=True):
            criteria = registration.ICPConvergenceCriteria(max_iteration=iterations)
            method = registration.TransformationEstimationForColoredICP()
            reach = _REACH_VOXELS * voxel
            try:
                result = registration.registration_colored_icp(p, q, reach, T, method, criteria)
            except RuntimeError as error:
                raise NoTransformError(str(error).strip()) from error
            T = np.array(result.transformation, np.float64)
        return T


class Open3dOdometry:
    """RGB-D odometry with the hybrid term of Park, Zhou and Koltun (2017)."""

    def __init__(self) -> None:
        self._open3d = load_open3d("open3d_odometry")

    def prepare(self, view: View) -> tuple[Any, Any]:
        """The frame's image and camera."""
        o3d = self._open3d
        # the library treats depth 0 as unknown
        depth = np.nan_to_num(view.depth).astype(np.float32)
        image = o3d.geometry.RGBDImage.create_from_color_and_depth(
            o3d.geometry.Image(np.ascontiguousarray(np.repeat(view.grey[..., None], 3, axis=2))),
            o3d.geometry.Image(depth),
            depth_scale=1.0,
            depth_trunc=_FAR_M,
            convert_rgb_to_intensity=True,
        )
        K = view.intrinsics
        camera = o3d.camera.PinholeCameraIntrinsic(K.width, K.height, K.fx, K.fy, K.cx, K.cy)
        return image, camera

    def register(self, source: tuple[Any, Any], target: tuple[Any, Any]) -> Float64:
        """T_target_source; the frames are of one camera."""
        odometry = self._open3d.pipelines.odometry
        found, T, information = odometry.compute_rgbd_odometry(
            source[0],
            target[0],
            target[1],
            np.eye(4),
            odometry.RGBDOdometryJacobianFromHybridTerm(),
            odometry.OdometryOption(depth_max=_FAR_M),
        )
        # every pixel adds to the elements off the diagonal
        if not found or not np.any(information - np.diag(np.diag(information))):
            raise NoTransformError("too few pixels correspond")
        return np.array(T, np.float64)


class Open3dTensorOdometry:
    """The same term in the library's newer, tensor part, over three scales."""

    def __init__(self) -> None:
        self._open3d = load_open3d("open3d_tensor_odometry")

    def prepare(self, view: View) -> tuple[Any, Any]:
        """The frame's image and camera."""
        o3d = self._open3d
        color = np.repeat(view.grey[..., None], 3, axis=2)
        image = o3d.t.geometry.RGBDImage(
            o3d.t.geometry.Image(o3d.core.Tensor(np.ascontiguousarray(color))),
            o3d.t.geometry.Image(o3d.core.Tensor(np.nan_to_num(view.depth).astype(np.float32))),
        )
        return image, o3d.core.Tensor(view.intrinsics.matrix)

    def register(self, source: tuple[Any, Any], target: tuple[Any, Any]) -> Float64:
        """T_target_source; the frames are of one camera."""
        odometry = self._open3d.t.pipelines.odometry
        try:
            result = odometry.rgbd_odometry_multi_scale(
                source[0], target[0], target[1], depth_scale=1.0, depth_max=_FAR_M
            )
        except RuntimeError as error:
            raise NoTransformError(str(error).strip()) from error
        if result.fitness == 0:
            raise NoTransformError("too few pixels correspond")
        return np.asarray(result.transformation.numpy(), np.float64)
