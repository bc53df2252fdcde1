"""Rotation of the camera between two whole images; it tolerates more blur than keypoints do.

A rotation shifts the whole image in the same way, whatever it shows, and often so far that
refinement from the expected pose fails. It is visible in small images (Klein and Murray 2008).
"""

from __future__ import annotations

import cv2
import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import Float32, Float64, UInt8, View

# Of the longer side. Fewer pixels tolerate more blur, more measure a turn more exactly; refinement
# covers some degrees.
_LENGTH_PX = 128


def turn_between(before: View, now: View) -> Float64:
    """The rotation R_before_now [3, 3] that aligns one image with the other, without roll.

    It comes from phase correlation (Kuglin and Hines 1975), which returns a rotation for any two
    images: the caller must check whether it is right. The error is one pixel of a small image, half
    a degree, plus the effect of translation if the scene is near.

    Args:
        before: the earlier view; only its image is used.
        now: a later view of the same camera, possibly of another size.
    """
    K = now.intrinsics
    width, height = (max(2, n * _LENGTH_PX // max(K.width, K.height)) for n in (K.width, K.height))
    small_before, small_now = (_resized(view.grey, width, height) for view in (before, now))
    window = cv2.createHanningWindow((width, height), cv2.CV_32F)
    (du, dv), _ = cv2.phaseCorrelate(small_before, small_now, window)
    # where the middle of the previous image is now
    ray = np.array([du * K.width / width / K.fx, dv * K.height / height / K.fy, 1.0])
    across = np.hypot(ray[0], ray[1])
    axis = np.array([ray[1], -ray[0], 0.0]) / max(across, 1e-12)
    turn = se3.exp(np.concatenate([np.zeros(3), np.arctan(across) * axis]))
    rotation: Float64 = turn[:3, :3]
    return rotation


def _resized(grey: UInt8, width: int, height: int) -> Float32:
    resized = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(resized, np.float32)
