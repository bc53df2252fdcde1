"""Image pyramids, whose coarse levels let a search converge from farther away."""

from __future__ import annotations

from threading import Lock

import cv2
import numpy as np

from rgbd_glue_ros.types import UInt8


class ImagePyramid:
    """An image and smaller ones, each half the size of the one before.

    A level is computed when it is first used, and kept as long as the pyramid. Thread-safe.
    """

    def __init__(self, image: UInt8) -> None:
        self._images = [image]
        self._lock = Lock()

    def at_level(self, level: int) -> UInt8:
        """The image at a level, uint8 [H / 2^level, W / 2^level]; at level 0 the original."""
        with self._lock:
            while len(self._images) <= level:
                self._images.append(np.asarray(cv2.pyrDown(self._images[-1]), np.uint8))
            return self._images[level]
