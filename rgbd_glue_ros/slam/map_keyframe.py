"""A keyframe with all that comparing it with others needs."""

from __future__ import annotations

from dataclasses import dataclass

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.keyframe import NewestKeyframe
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.model import Model, model_of
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.types import Float64, View


@dataclass(frozen=True)
class MapKeyframe:
    """A keyframe that can be compared with others; ``StoredKeyframe`` is what the map keeps of it.

    Attributes:
        row: in the pose graph.
        stamp_ns: of the frame.
        T_odom_camera: float64 [4, 4], as the odometry published it.
        features: of the frame.
        model: its planes and pixels, in its own camera's frame.
    """

    row: int
    stamp_ns: int
    T_odom_camera: Float64
    features: FrameFeatures
    model: Model

    @staticmethod
    def of(keyframe: NewestKeyframe, T_odom_camera: Float64) -> MapKeyframe:
        """A keyframe of the odometry, published with the pose ``T_odom_camera`` [4, 4]."""
        model = keyframe.model.moved(se3.inverse(keyframe.T_track_camera))
        return MapKeyframe(
            keyframe.number, keyframe.stamp_ns, T_odom_camera, keyframe.features, model
        )

    @staticmethod
    def seen(
        row: int, stamp_ns: int, T_odom_camera: Float64, view: View, glue: Glue, config: Config
    ) -> MapKeyframe:
        """A keyframe known only by its view and its pose [4, 4]."""
        model = model_of(view, config.refine.grid_step)
        return MapKeyframe(row, stamp_ns, T_odom_camera, glue.extract(view), model)
