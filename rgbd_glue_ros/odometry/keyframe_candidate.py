"""A frame with a pose, which may become a keyframe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.normals import spacing_px
from rgbd_glue_ros.odometry.tracked_pose import TrackedPose
from rgbd_glue_ros.parameters import OdometryConfig, RefineConfig
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.types import View


@dataclass(frozen=True)
class KeyframeCandidate:
    """A frame with a pose.

    Attributes:
        pose: as tracked.
        features: of the frame.
        overlap: the fraction of the view that the keyframes showed too.
    """

    pose: TrackedPose
    features: FrameFeatures
    overlap: float

    def distance(self, config: OdometryConfig) -> float:
        """Distance from the reference, in units of that at which a frame becomes a keyframe."""
        T = se3.inverse(self.pose.reference.T_track_camera) @ self.pose.T_track_camera
        return max(
            float(np.linalg.norm(T[:3, 3])) / config.keyframe_translation,
            se3.rotation_angle(T) / config.keyframe_rotation,
        )


def overlap(view: View, refinement: Refinement, config: RefineConfig) -> float:
    """The fraction of a frame's view that the keyframes showed too.

    Args:
        view: the frame.
        refinement: its pose on the keyframes, at the finest level.
        config: has the spacing of their planes.
    """
    step = spacing_px(view, config.grid_step)
    known = np.isfinite(view.depth[step // 2 :: step, step // 2 :: step]).sum()
    return refinement.planes_seen / max(int(known), 1)
