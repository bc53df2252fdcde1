"""Frames as a camera provides them, and prepared for registration."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from rgbd_glue_ros.types.arrays import Float32, Float64, UInt8
from rgbd_glue_ros.types.camera import CameraIntrinsics
from rgbd_glue_ros.types.checks import check_camera, check_frame, check_frame_id, check_stamps


@dataclass(frozen=True, eq=False)
class RgbdFrame:
    """One colour image with the depth image registered to it.

    Attributes:
        stamp_ns: time of the colour image, nanoseconds.
        color: uint8, [H, W, 3] RGB or [H, W] grey.
        depth: float32 [H, W], metres along the optical axis, NaN where unknown.
        intrinsics: of both images; if they have no size, they take that of the images.
        frame_id: the optical frame of the camera, from the message header; "" if unknown.
        depth_delay_ns: stamp of the depth image minus ``stamp_ns``, nanoseconds.
    """

    stamp_ns: int
    color: UInt8
    depth: Float32
    intrinsics: CameraIntrinsics
    frame_id: str = ""
    depth_delay_ns: int = 0

    def __post_init__(self) -> None:
        """Checks the images.

        Raises:
            InputError: an image has another type or shape; another unit is not noticed here.
        """
        camera = self.intrinsics
        check_camera(camera, CameraIntrinsics)
        check_frame(self.color, self.depth, camera.width, camera.height)
        check_stamps(self.stamp_ns, self.depth_delay_ns)
        check_frame_id(self.frame_id)
        # NumPy's would overflow
        object.__setattr__(self, "stamp_ns", int(self.stamp_ns))
        object.__setattr__(self, "depth_delay_ns", int(self.depth_delay_ns))
        if camera.width == 0:
            height, width = self.depth.shape
            sized = replace(camera, width=width, height=height)
            object.__setattr__(self, "intrinsics", sized)


@dataclass(frozen=True, eq=False)
class View:
    """A frame prepared for registration: no distortion, no depth out of range.

    Attributes:
        grey: uint8 [H, W].
        depth: float32 [H, W], metres, NaN where unknown.
        intrinsics: of both.
        twist: float64 [6], velocity of the camera (linear, angular; m/s, rad/s; optical frame)
            when the image was taken; zero if it is not known.
        readout_time: seconds from the first row to the last of a rolling shutter; 0 for a global
            shutter.
        depth_delay: how much later than colour depth was taken, seconds.
        contrast: of ``grey``, relative to a well-lit image; grey-level limits are multiplied by
            it.
        depth_noise: of ``depth``, relative to ``depth_sigma``, at least 1; limits of depth are
            multiplied by it.
    """

    grey: UInt8
    depth: Float32
    intrinsics: CameraIntrinsics
    twist: Float64 = field(default_factory=lambda: np.zeros(6))
    readout_time: float = 0.0
    depth_delay: float = 0.0
    contrast: float = 1.0
    depth_noise: float = 1.0
