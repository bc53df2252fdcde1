"""Small pictures of some frames of a replay, for its report."""

from __future__ import annotations

import cv2
import numpy as np

from rgbd_glue_ros.messages.image_codecs import encode_jpeg
from rgbd_glue_ros.types import OdometryEstimate, RgbdFrame, UInt8

WIDTH = 160
_QUALITY = 70
_MOST = 400


class Thumbnails:
    """A ``FrameSink`` that keeps pictures spread over a replay of any length.

    Attributes:
        jpegs: by stamp, pictures ``WIDTH`` pixels wide; a few hundred of them at most.
    """

    def __init__(self) -> None:
        """Starts without pictures."""
        self.jpegs: dict[int, bytes] = {}
        self._frames = 0
        self._every = 1

    def add(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Adds a frame."""
        if self._frames % self._every == 0:
            self.jpegs[estimate.stamp_ns] = thumbnail(frame.color)
        self._frames += 1
        if len(self.jpegs) > _MOST:
            self.jpegs = dict(list(self.jpegs.items())[::2])
            self._every *= 2

    def start_anew(self) -> None:
        """Nothing: a picture is of its stamp."""

    def close(self) -> None:
        """Does nothing: the pictures are in memory."""


def thumbnail(color: UInt8) -> bytes:
    """An image [H, W, 3] RGB or [H, W] grey as a small JPEG."""
    height, width = color.shape[:2]
    size = WIDTH, max(1, round(height * WIDTH / width))
    small = cv2.resize(color, size, interpolation=cv2.INTER_AREA)
    bgr = small if small.ndim == 2 else np.ascontiguousarray(small[:, :, ::-1])
    return encode_jpeg(bgr, _QUALITY)
