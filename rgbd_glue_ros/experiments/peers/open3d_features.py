"""Open3D's global registrations from FPFH alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from rgbd_glue_ros.experiments.peers.base import NoTransformError
from rgbd_glue_ros.experiments.peers.open3d_library import load_open3d
from rgbd_glue_ros.features.geometric import VoxelFpfh
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.types import Float64, View

_VOXEL_M = 0.025

# Fraction of an edge's length, as in Open3D's tutorial on global registration.
_EDGE_SIMILARITY = 0.9


class _Fpfh:
    """Points and features of a frame, the same as for the paper's method."""

    def __init__(self, name: str) -> None:
        self._open3d = load_open3d(name)
        self._features = VoxelFpfh(FeaturesConfig(geometric="fpfh", voxel=_VOXEL_M))

    def prepare(self, view: View) -> tuple[Any, Any]:
        """The cloud and its features.

        Raises:
            NoTransformError: the frame has no depth.
        """
        described = self._features.extract(view)
        if not len(described.points):
            raise NoTransformError("no depth")
        cloud = self._open3d.geometry.PointCloud(
            self._open3d.utility.Vector3dVector(described.points)
        )
        feature = self._open3d.pipelines.registration.Feature()
        feature.data = described.descriptors.T.astype(np.float64)
        return cloud, feature


class FeatureRansac(_Fpfh):
    """RANSAC over nearest neighbours in feature space."""

    def __init__(self) -> None:
        super().__init__("fpfh_ransac")

    def register(self, source: tuple[Any, Any], target: tuple[Any, Any]) -> Float64:
        """T_target_source."""
        registration = self._open3d.pipelines.registration
        distance = 1.5 * _VOXEL_M
        result = registration.registration_ransac_based_on_feature_matching(
            source[0],
            target[0],
            source[1],
            target[1],
            mutual_filter=True,
            max_correspondence_distance=distance,
            ransac_n=3,
            checkers=[
                registration.CorrespondenceCheckerBasedOnEdgeLength(_EDGE_SIMILARITY),
                registration.CorrespondenceCheckerBasedOnDistance(distance),
            ],
            criteria=registration.RANSACConvergenceCriteria(100_000, 0.999),
        )
        return _transform(result)


class FastGlobal(_Fpfh):
    """Fast Global Registration (Zhou, Park and Koltun 2016)."""

    def __init__(self) -> None:
        super().__init__("fpfh_fgr")

    def register(self, source: tuple[Any, Any], target: tuple[Any, Any]) -> Float64:
        """T_target_source."""
        registration = self._open3d.pipelines.registration
        result = registration.registration_fgr_based_on_feature_matching(
            source[0],
            target[0],
            source[1],
            target[1],
            registration.FastGlobalRegistrationOption(
                maximum_correspondence_distance=0.5 * _VOXEL_M
            ),
        )
        return _transform(result)


def _transform(result: Any) -> Float64:
    if not len(result.correspondence_set):
        raise NoTransformError("no points correspond")
    return np.array(result.transformation, np.float64)
