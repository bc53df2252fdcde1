"""A white wall with a poster at its left, and a camera that moves along it a metre away."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from rgbd_glue_ros.types import NANOSECONDS, CameraIntrinsics, Float64, RgbdFrame

HZ = 15
CAMERA = CameraIntrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
POSTER_M = 1.2
"""Width of the poster: from this position on the camera does not see it."""
VIEW_M = 1.22
"""Width of what the camera sees."""
_DISTANCE_M = 1.0
_DEPTH_NOISE_M, _BRIGHTNESS_NOISE = 0.008, 2.0


def frames(positions: Float64, seed: int, poster_m: float = POSTER_M) -> Iterator[RgbdFrame]:
    """What the camera sees.

    Args:
        positions: of the camera along the wall, metres, one for each frame.
        seed: of the poster, and of the noise of a Kinect.
        poster_m: width of the poster, metres.
    """
    rng = np.random.default_rng(seed)
    wall = _wall(rng, round(poster_m * CAMERA.fx / _DISTANCE_M))
    for i, x in enumerate(positions):
        to_wall = np.array([[1, 0, x * CAMERA.fx / _DISTANCE_M], [0, 1, 100]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpAffine(wall, to_wall, (640, 480), flags=flags)
        color = np.clip(seen + rng.normal(0, _BRIGHTNESS_NOISE, seen.shape), 0, 255)
        noise = cv2.GaussianBlur(rng.normal(0, 1, (480, 640)), (0, 0), 2)
        depth = np.round(1000 * (_DISTANCE_M + _DEPTH_NOISE_M * noise)) / 1000
        stamp_ns = i * NANOSECONDS // HZ
        yield RgbdFrame(stamp_ns, color.astype(np.uint8), depth.astype(np.float32), CAMERA)


def _wall(rng: np.random.Generator, poster_px: int) -> Float64:
    """Its brightness, float64 [H, W, 3]; a pixel of the camera's at its distance each."""
    blobs = cv2.GaussianBlur(rng.integers(0, 256, (700, poster_px, 3), np.uint8), (0, 0), 3)
    wall = np.full((700, 2400, 3), 225.0)
    wall[:, :poster_px] = np.clip((blobs.astype(np.float64) - 128) * 4 + 128, 0, 255)
    return wall
