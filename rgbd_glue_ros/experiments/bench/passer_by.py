"""A person who walks up and down in front of the camera of a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from rgbd_glue_ros.types import NANOSECONDS, CameraIntrinsics, Float64, RgbdFrame, UInt8

_SEED = 0
# The cloth repeats after this many patches, which are this wide.
_PATCHES, _PATCH_M = 256, 0.01
_CONTRAST = 50.0


@dataclass(frozen=True)
class PasserBy:
    """An upright cylinder in mottled cloth that moves from side to side in front of the camera.

    Its position is in the camera's frame, like that of a companion, and it hides what is behind.

    Attributes:
        distance: of its axis, metres.
        radius: metres.
        reach: maximum distance to each side of the optical axis, metres.
        period: of a complete cycle, seconds.
        tall: its height above the optical axis, metres.
    """

    distance: float = 1.5
    radius: float = 0.28
    reach: float = 1.8
    period: float = 8.0
    tall: float = 0.75

    def before(self, frame: RgbdFrame, start_ns: int) -> RgbdFrame:
        """The frame with the passer-by, who started from the left at ``start_ns``."""
        seconds = (frame.stamp_ns - start_ns) / NANOSECONDS
        axis_x = -self.reach * np.cos(2 * np.pi * seconds / self.period)
        K = frame.intrinsics
        z, angle = self._seen(K, axis_x)
        y = _rays(K.height, K.fy, K.cy)[:, np.newaxis] * z
        # unknown depth of the room is assumed to be behind
        shown = np.isfinite(z) & (y > -self.tall) & ~(frame.depth <= z)
        rows = (np.where(shown, y, 0.0) / _PATCH_M).astype(np.int64) % _PATCHES
        columns = (np.where(np.isfinite(z), angle * self.radius, 0.0) / _PATCH_M).astype(np.int64)
        cloth = _cloth()[rows, columns % _PATCHES]
        mask = shown if frame.color.ndim == 2 else shown[..., np.newaxis]
        tint = cloth if frame.color.ndim == 2 else cloth[..., np.newaxis]
        return replace(
            frame,
            color=np.where(mask, tint, frame.color),
            depth=np.where(shown, z, frame.depth).astype(np.float32),
        )

    def _seen(self, K: CameraIntrinsics, axis_x: float) -> tuple[Float64, Float64]:
        """Depth and angle around the axis in each column [W] of the image; NaN beside it."""
        ray = _rays(K.width, K.fx, K.cx)
        # (ray z - axis_x)² + (z - distance)² = radius², and of the two the nearer z
        along = ray**2 + 1
        towards = ray * axis_x + self.distance
        rest = towards**2 - along * (axis_x**2 + self.distance**2 - self.radius**2)
        z = (towards - np.sqrt(np.where(rest > 0, rest, np.nan))) / along
        return z, np.arctan2(ray * z - axis_x, self.distance - z)


def _rays(pixels: int, focal: float, centre: float) -> Float64:
    """Where the rays of a row or column of pixels pass the plane at 1 m."""
    return np.asarray((np.arange(pixels) - centre) / focal, np.float64)


@lru_cache(maxsize=1)
def _cloth() -> UInt8:
    """The cloth's brightness, uint8 [patches, patches]."""
    noise = np.random.default_rng(_SEED).normal(size=(_PATCHES, _PATCHES)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.asarray(np.clip(120 + _CONTRAST * smooth / smooth.std(), 0, 255), np.uint8)
