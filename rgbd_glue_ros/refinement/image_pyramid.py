"""Image pyramids, whose coarse levels let a search see far."""

from __future__ import annotations

from threading import Lock

import cv2
import numpy as np

from rgbd_glue_ros.types import UInt8


class ImagePyramid:
    """An image and smaller ones, each half the size of the one before.

    A level is made when it is first asked for, by whichever thread asks, and kept as long as the
    pyramid is.
    """

    def __init__(self, image: UInt8) -> None:
        self._images = [image]
        self._lock = Lock()

    def at_level(self, level: int) -> UInt8:
        """The image at a level, uint8 [H / 2^level, W / 2^level]; at 0 the one that was given."""
        with self._lock:
            while len(self._images) <= level:
                self._images.append(np.asarray(cv2.pyrDown(self._images[-1]), np.uint8))
            return self._images[level]
