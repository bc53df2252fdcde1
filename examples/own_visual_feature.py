"""A custom visual feature, AKAZE: python examples/own_visual_feature.py bags/living_room."""

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import rgbd_glue_ros as glue


class Akaze:
    """Extracts features of a frame (``extract``) and matches those of two frames (``match``)."""

    def __init__(self, _config: object) -> None:
        self._detector = cv2.AKAZE.create()
        self._matcher = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)

    def extract(self, view: glue.View) -> Any:
        """Pixels [N, 2] and descriptors [N, 61] of the grey image; kept with the frame."""
        keypoints, descriptors = self._detector.detectAndCompute(view.grey, None)
        return np.asarray(cv2.KeyPoint.convert(keypoints), np.float32), descriptors

    def match(self, source: Any, target: Any) -> glue.VisualMatches:
        """Pixels of either image, and a weight for each match."""
        pairs = [(m.queryIdx, m.trainIdx) for m in self._matcher.match(source[1], target[1])]
        i, j = np.array(pairs, np.int64).reshape(-1, 2).T
        return glue.VisualMatches(source[0][i], target[0][j], np.ones(len(i)))


glue.add_visual_feature("akaze", Akaze)
if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python examples/own_visual_feature.py RECORDING")
    config = glue.with_values(glue.load_preset("live"), {"features.visual": "akaze"})
    with glue.open_recording(Path(sys.argv[1])) as recording, glue.Odometry(config) as odometry:
        print([odometry.process(frame).state.value for frame in recording])
