"""Follows the parts of the robot in view from frame to frame."""

from __future__ import annotations

from rgbd_glue_ros.odometry.background import BackgroundThread, BackgroundValue
from rgbd_glue_ros.odometry.own_parts import OwnParts
from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.types import Float64, View


class OwnPartsTracker:
    """Looks for parts of the robot on the background thread, and leaves them out of later frames.

    The next frame is the first to need what was found, and ``left_out`` waits for it.
    """

    def __init__(self, background: BackgroundThread, config: OdometryConfig) -> None:
        self._is_on = config.own_parts
        self._own_parts = BackgroundValue(background, OwnParts())

    def reconfigure(self, config: OdometryConfig) -> None:
        """Sets other parameters; what was found remains, unless it is no longer looked for."""
        self._is_on = config.own_parts
        if not self._is_on:
            self._own_parts.replace(OwnParts())

    def start_anew(self) -> None:
        """Continues with poses that cannot be compared with earlier ones."""
        self._own_parts.replace(self._own_parts.current().without_views())

    def left_out(self, view: View) -> View:
        """A view without the parts known so far."""
        return self._own_parts.current().left_out(view)

    def compare(self, view: View, T_track_camera: Float64) -> None:
        """Compares a frame that has its pose with earlier ones.

        Args:
            view: the frame with all that it shows, these parts too.
            T_track_camera: its pose, float64 [4, 4].
        """
        if self._is_on and self._own_parts.current().needs(view, T_track_camera):
            self._own_parts.update_later(OwnParts.after_view, view, T_track_camera)
