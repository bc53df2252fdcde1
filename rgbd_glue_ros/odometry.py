"""Keyframe odometry: registers every frame against a keyframe and keeps the tracking state."""

from __future__ import annotations

from rgbd_glue_ros.config import Config
from rgbd_glue_ros.types import OdometryEstimate, RgbdFrame, TrackingState


class Odometry:
    """Turns RGB-D frames into poses T_odom_camera.

    Deterministic: the same frames and configuration give the same bits. Not thread-safe: one
    thread calls ``process``.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self.state = TrackingState.INITIALIZING

    def process(self, frame: RgbdFrame) -> OdometryEstimate:
        """Registers ``frame`` and returns what is known after it; never raises on image content."""
        raise NotImplementedError

    def reset(self) -> None:
        """Forgets everything; the next frame starts a new odom frame at the identity."""
