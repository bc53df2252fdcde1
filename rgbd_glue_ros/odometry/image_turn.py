"""How far the camera has turned, by whole images: blur takes keypoints away before it takes that.

A turn moves all of an image alike, whatever is seen, and so much that refinement does not find back
from where the camera was expected. Small images show it (Klein and Murray 2008).
"""

from __future__ import annotations

import cv2
import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import Float32, Float64, UInt8, View

# Of the longer side. Fewer pixels see through more blur, more see a turn more exactly; refinement
# reaches some degrees.
_LENGTH_PX = 128


def turn_between(before: View, now: View) -> Float64:
    """The rotation R_before_now [3, 3] that lays one image over the other, without roll.

    By phase correlation (Kuglin and Hines 1975), which gives some rotation of any two images:
    whether it is right is for its user to see. Errs by a pixel of a small image, half a degree, and
    by what the camera's way does to a scene that is near.

    Args:
        before: a view, for its image.
        now: another one of the same camera, if perhaps of another size.
    """
    K = now.intrinsics
    width, height = (max(2, n * _LENGTH_PX // max(K.width, K.height)) for n in (K.width, K.height))
    small_before, small_now = (_resized(view.grey, width, height) for view in (before, now))
    window = cv2.createHanningWindow((width, height), cv2.CV_32F)
    (du, dv), _ = cv2.phaseCorrelate(small_before, small_now, window)
    # where the middle of the image before is seen now
    ray = np.array([du * K.width / width / K.fx, dv * K.height / height / K.fy, 1.0])
    across = np.hypot(ray[0], ray[1])
    axis = np.array([ray[1], -ray[0], 0.0]) / max(across, 1e-12)
    turn = se3.exp(np.concatenate([np.zeros(3), np.arctan(across) * axis]))
    rotation: Float64 = turn[:3, :3]
    return rotation


def _resized(grey: UInt8, width: int, height: int) -> Float32:
    resized = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(resized, np.float32)
