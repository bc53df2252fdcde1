"""Messages of one frame, as the tests of their readers take them."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.messages.fields import Image
from rgbd_glue_ros.messages.frame import FrameTopics
from rgbd_glue_ros.messages.making import header
from rgbd_glue_ros.types import CameraIntrinsics

HEAD = header(1_234_567_890_123_456_789, "camera_optical")
TOPICS = FrameTopics("/color", "/depth", "/info")
CAMERA = CameraIntrinsics(64, 48, 60.0, 61.0, 31.5, 23.5, (0.1, -0.2, 0.001, 0.002, 0.3))
RGB = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
DEPTH = np.random.default_rng(1).uniform(0.3, 9.0, (48, 64)).astype(np.float32)


def raw(
    pixels: NDArray[Any], encoding: str, *, is_bigendian: bool = False, padding: int = 0
) -> Image:
    """An Image message with rows padded by some bytes."""
    dtype = pixels.dtype.newbyteorder(">" if is_bigendian else "<")
    swapped = np.ascontiguousarray(pixels.astype(dtype))
    rows = swapped.view(np.uint8).reshape(len(pixels), -1)
    padded = np.pad(rows, [(0, 0), (0, padding)], constant_values=0xAB)
    height, width = pixels.shape[:2]
    return Image(
        HEAD, height, width, encoding, int(is_bigendian), padded.shape[1], padded.reshape(-1)
    )


def smooth(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Something that JPEG can hold."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 4), np.uint8)


def flat(data: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(data, np.uint8)
