"""Registration methods by others, for comparison on the same frames.

Each needs an optional library (extra ``bench``), uses the settings in its documentation, and starts
without a prior or motion model.
"""

from __future__ import annotations

from collections.abc import Callable

from rgbd_glue_ros.experiments.peers.base import NoTransformError, Peer
from rgbd_glue_ros.experiments.peers.open3d_features import FastGlobal, FeatureRansac
from rgbd_glue_ros.experiments.peers.open3d_odometry import (
    ColoredIcp,
    Open3dOdometry,
    Open3dTensorOdometry,
)
from rgbd_glue_ros.experiments.peers.opencv_odometry import opencv_icp, opencv_rgbd, opencv_rgbd_icp
from rgbd_glue_ros.experiments.peers.published import Mac, Sc2Pcr
from rgbd_glue_ros.experiments.peers.small_gicp import SmallGicp

PEERS: dict[str, Callable[[], Peer]] = {
    "fpfh_ransac": FeatureRansac,
    "fpfh_fgr": FastGlobal,
    "fpfh_sc2_pcr": Sc2Pcr,
    "fpfh_mac": Mac,
    "colored_icp": ColoredIcp,
    "open3d_odometry": Open3dOdometry,
    "open3d_tensor_odometry": Open3dTensorOdometry,
    "opencv_rgbd": opencv_rgbd,
    "opencv_icp": opencv_icp,
    "opencv_rgbd_icp": opencv_rgbd_icp,
    "small_gicp": SmallGicp,
}
"""Creates a peer by name; raises MissingExtraError or InputError without its library."""

__all__ = ["PEERS", "NoTransformError", "Peer"]
