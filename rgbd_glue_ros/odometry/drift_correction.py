"""Takes drift out again where the camera comes back to what it saw before.

Tracking compares a frame with the latest few keyframes, and their errors add up. A keyframe that
sees what a much earlier one saw is compared with that one, too: what the two disagree by has
drifted in between. The pose follows bit by bit, by a small part of the way that the camera makes
anyway, so that it is as smooth as before (REP-105) and stands still where the camera does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import SURPRISE, mahalanobis_squared
from rgbd_glue_ros.odometry.acceptance import is_conclusive
from rgbd_glue_ros.odometry.keyframe_edges import revisit_edge
from rgbd_glue_ros.odometry.keyframes import Anchor, Keyframe
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.gauss_newton import COARSE_TO_FINE, refine
from rgbd_glue_ros.types import Float64, PoseGraphEdge

# The finest level costs half of the time and adds a digit that the anchor's own pose has not.
_LEVELS = COARSE_TO_FINE[:-1]


@dataclass(frozen=True)
class DriftCorrection:
    """What takes the drift out of poses as tracked, multiplied on the left.

    Attributes:
        T_odom_track: that of now, float64 [4, 4].
        target: where it goes.
        edge: what the comparison that has just been made measured; None if none was.
    """

    T_odom_track: Float64
    target: Float64
    edge: PoseGraphEdge | None = None

    @staticmethod
    def at(T_odom_track: Float64) -> DriftCorrection:
        """Drift that is taken out already."""
        return DriftCorrection(T_odom_track, T_odom_track)

    def advanced(self, T_before: Float64, T_now: Float64, rate: float) -> DriftCorrection:
        """The drift after the camera has moved.

        Args:
            T_before: T_track_camera, float64 [4, 4].
            T_now: the same, later.
            rate: by which part of the camera's way, metres and radians added, the pose is moved to
                where it is wanted, at most.
        """
        corrected = self.T_odom_track @ T_now
        left = se3.log(se3.inverse(corrected) @ self.target @ T_now)
        length = float(np.linalg.norm(left[:3]) + np.linalg.norm(left[3:]))
        allowed = rate * se3.difference(T_before, T_now)
        if length <= allowed:
            return DriftCorrection.at(self.target)
        moved = corrected @ se3.exp(left * (allowed / length))
        return DriftCorrection(moved @ se3.inverse(T_now), self.target)

    def after_revisit(self, keyframe: Keyframe, anchor: Anchor, config: Config) -> DriftCorrection:
        """The drift after a keyframe was compared with one of long ago.

        Args:
            keyframe: the newest.
            anchor: sees the same part of the room.
            config: how they are compared, and when that is believed.
        """
        T = keyframe.T_track_camera
        expected = self.target @ T
        start = se3.inverse(anchor.T_odom_track) @ expected
        found = refine(start, anchor.model, keyframe.features.view, config.refine, _LEVELS)
        if not is_conclusive(found, config.odometry):
            return self
        T_seen = anchor.T_odom_track @ found.T_model_source
        off = se3.log(T_seen @ se3.inverse(expected))
        # drift that the covariance finds less likely is a place that looks like another
        if not mahalanobis_squared(off, keyframe.covariance) <= SURPRISE:
            return self
        edge = revisit_edge(anchor, keyframe, found, config)
        return DriftCorrection(self.T_odom_track, T_seen @ se3.inverse(T), edge)
