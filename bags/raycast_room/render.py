"""Pictures of a scene: exact depth, and colour averaged over the exposure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raycast_room.raycaster import Tables, cast_color, cast_depth
from rgbd_glue_ros.types import CameraIntrinsics, Float32, Float64, UInt8

_FINE = 4095  # steps of linear light that the sRGB curve is tabulated at

EXPOSURES = 6  # rays a pixel, each at another time; no two in one row or column of a 6 x 6 grid
_OFFSETS = (np.array([(0, 3), (1, 0), (2, 4), (3, 1), (4, 5), (5, 2)]) - 2.5) / 6.0

# sixteenths of a grey level; rounded, so that powers that differ in the last bit do not show
_SRGB = np.array(
    [
        round(
            16 * 255 * (12.92 * x if x <= 0.0031308 else 1.055 * round(x ** (1 / 2.4), 12) - 0.055)
        )
        for x in (i / _FINE for i in range(_FINE + 1))
    ],
    np.int32,
)


def render(
    scene: Tables, T_world_camera: Float64, intrinsics: CameraIntrinsics
) -> tuple[UInt8, Float32]:
    """A picture without noise or blur.

    Args:
        scene: as from ``living_room``.
        T_world_camera: pose of the camera's optical frame, [4, 4]; the world has z up.
        intrinsics: of the camera; without distortion.

    Returns:
        Colour uint8 [H, W, 3] RGB and depth float32 [H, W], metres along the optical axis.
    """
    image = develop(expose(scene, np.repeat(T_world_camera[None], EXPOSURES, axis=0), intrinsics))
    depth, _ = measure(scene, T_world_camera, 0.0, intrinsics)
    return to_uint8(image), depth.astype(np.float32)


def expose(scene: Tables, poses: Float64, intrinsics: CameraIntrinsics) -> Float32:
    """Linear light averaged over an exposure.

    Args:
        scene: as from ``living_room``.
        poses: T_world_camera at ``EXPOSURES`` times within the exposure, [6, 4, 4].
        intrinsics: of the camera.

    Returns:
        Linear RGB, float32 [H, W, 3], 1 for white.
    """
    image = np.empty((intrinsics.height, intrinsics.width, 3), np.float32)
    cast_color(scene, np.ascontiguousarray(poses), _OFFSETS, _pinhole(intrinsics), image)
    return image


def measure(
    scene: Tables, T_world_camera: Float64, baseline: float, intrinsics: CameraIntrinsics
) -> tuple[Float64, Float64]:
    """What a structured-light sensor sees, before noise.

    Args:
        scene: as from ``living_room``.
        T_world_camera: [4, 4].
        baseline: metres from the camera to the projector, along the camera's x.
        intrinsics: of the camera.

    Returns:
        Depth [H, W] in metres, and the strength of the echo [H, W]: infrared reflectivity times
        cosine of incidence over squared depth, 0 in the projector's shadow.
    """
    depth = np.empty((intrinsics.height, intrinsics.width))
    echo = np.empty_like(depth)
    T = np.ascontiguousarray(T_world_camera)
    projector = T[:3, 3] + baseline * T[:3, 0]
    cast_depth(scene, T, projector, _pinhole(intrinsics), depth, echo)
    return depth, echo


def _pinhole(intrinsics: CameraIntrinsics) -> tuple[float, float, float, float]:
    return float(intrinsics.fx), float(intrinsics.fy), float(intrinsics.cx), float(intrinsics.cy)


def develop(linear: Float32) -> NDArray[np.int32]:
    """Linear light [H, W, 3] as sRGB in sixteenths of a grey level; bright parts roll off."""
    # identity up to 0.6, then a hyperbola of the same slope towards 1
    over = np.maximum(linear - np.float32(0.6), np.float32(0.0))
    rolled = np.minimum(linear, np.float32(0.6)) + over / (np.float32(1.0) + over * np.float32(2.5))
    index = np.clip(np.floor(rolled * np.float32(_FINE) + np.float32(0.5)), 0, _FINE)
    image: NDArray[np.int32] = _SRGB[index.astype(np.int32)]
    return image


def to_uint8(sixteenths: NDArray[np.int32]) -> UInt8:
    """Sixteenths of a grey level, rounded and clipped to bytes."""
    image: UInt8 = np.clip((sixteenths + 8) >> 4, 0, 255).astype(np.uint8)
    return image
