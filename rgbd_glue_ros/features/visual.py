"""The interface of visual features, and those that OpenCV computes: SIFT, ORB, BRISK."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.features.matching import distance_ratio, nearest_two, one_to_one
from rgbd_glue_ros.geometry.contrast import well_lit
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.types import (
    Float32,
    Float64,
    UInt8,
    View,
)

# For an image smaller than this OpenCV cannot build the pyramids of ORB and BRISK.
_SMALLEST_IMAGE_PX = 16


@dataclass(frozen=True)
class VisualMatches:
    """Matched pixels, one row per match.

    Attributes:
        source_uv: float32 [N, 2].
        target_uv: float32 [N, 2].
        weights: float64 [N] in [0, 1], larger for more distinctive matches.
    """

    source_uv: Float32
    target_uv: Float32
    weights: Float64

    def __len__(self) -> int:
        return len(self.weights)

    @staticmethod
    def empty() -> VisualMatches:
        """No matches."""
        return VisualMatches(
            np.empty((0, 2), np.float32), np.empty((0, 2), np.float32), np.empty(0)
        )


def check_matches(matches: object, name: str) -> None:
    """Refuses what a feature of somebody's own gives for matches.

    Args:
        matches: what ``match`` has returned.
        name: of the feature.

    Raises:
        InputError: it is of another class, or its arrays have not one row per match.
    """
    where = f"visual feature {name!r}"
    if not isinstance(matches, VisualMatches):
        cause = f"match returns {type(matches).__name__}, not VisualMatches"
        raise InputError(where, cause, "return VisualMatches(source_uv, target_uv, weights)")
    shapes = [np.shape(a) for a in (matches.source_uv, matches.target_uv, matches.weights)]
    count = shapes[2][:1]
    if shapes != [(*count, 2), (*count, 2), count]:
        source, target, weights = shapes
        raise InputError(
            where,
            f"match returns arrays of shape {source}, {target} and {weights}",
            "return one row per match: source_uv [N, 2], target_uv [N, 2], weights [N]",
        )


class VisualFeature(Protocol):
    """A way to find and match visual features.

    ``extract`` gives the features of a frame; ``match`` matches those of two frames.
    """

    def extract(self, view: View) -> Any:
        """The visual features of a frame."""

    def match(self, source: Any, target: Any) -> VisualMatches:
        """C_vis in pixels."""


@runtime_checkable
class KeypointFeature(VisualFeature, Protocol):
    """A visual feature that finds keypoints in each image and matches nothing but these.

    Of frames that are kept for long, the odometry then keeps depth at the keypoints alone.
    """

    def keypoints(self, features: Any) -> Float32:
        """The pixels, float32 [N, 2], of a frame's features: those that ``match`` can return."""


@dataclass(frozen=True)
class DescribedKeypoints:
    """Keypoints with descriptors.

    Attributes:
        uv: float32 [N, 2], pixels.
        descriptors: [N, D], float32, or uint8 for bit strings.
    """

    uv: Float32
    descriptors: Float32 | UInt8


class OpenCvFeature:
    """Keypoints and descriptors of OpenCV, matched by nearest neighbour and ratio test."""

    def __init__(self, detector: Any, config: FeaturesConfig) -> None:
        self._detector = detector
        self._config = config

    def extract(self, view: View) -> DescribedKeypoints:
        """Detects and describes the strongest keypoints."""
        nothing = DescribedKeypoints(np.empty((0, 2), np.float32), np.empty((0, 1), np.float32))
        if min(view.grey.shape) < _SMALLEST_IMAGE_PX:
            return nothing
        keypoints, descriptors = self._detector.detectAndCompute(well_lit(view), None)
        if descriptors is None:
            return nothing
        uv = np.asarray(cv2.KeyPoint.convert(keypoints), np.float32)
        response = np.array([k.response for k in keypoints])
        strongest = np.argsort(-response, kind="stable")[: self._config.keypoints]
        return DescribedKeypoints(uv[strongest], descriptors[strongest])

    def keypoints(self, features: DescribedKeypoints) -> Float32:
        """Pixels, float32 [N, 2]."""
        return features.uv

    def match(self, source: DescribedKeypoints, target: DescribedKeypoints) -> VisualMatches:
        """Equation 1: nearest neighbours whose ratio is below the threshold, one to one."""
        if len(source.uv) == 0 or len(target.uv) < 2:
            return VisualMatches.empty()
        index, distances = nearest_two(source.descriptors, target.descriptors)
        ratio = distance_ratio(distances)
        kept = np.flatnonzero(ratio <= self._config.ratio)
        kept = kept[one_to_one(index[kept], ratio[kept])]
        return VisualMatches(source.uv[kept], target.uv[index[kept]], 1.0 - ratio[kept])


def _create(name: str, **options: float) -> Any:
    """A detector of OpenCV; version 5 moved some of them out of its main package."""
    try:
        create: Callable[..., Any] = getattr(cv2, f"{name}_create")
    except AttributeError as error:
        raise InputError(
            f"features.visual: {name.lower()}",
            f"OpenCV {cv2.__version__} does not include it",
            "install opencv-python-headless<5",
        ) from error
    return create(**options)


def sift(config: FeaturesConfig) -> OpenCvFeature:
    """SIFT (Lowe 2004)."""
    return OpenCvFeature(_create("SIFT", nfeatures=config.keypoints), config)


def orb_detector(config: FeaturesConfig) -> Any:
    """OpenCV's ORB as the odometry uses it."""
    # half of OpenCV's default number of levels, at the same ratio: a third less time, and frames of
    # one camera rarely see an object at more than twice the scale
    return _create("ORB", nfeatures=config.keypoints, fastThreshold=10, nlevels=4, scaleFactor=1.4)


def orb(config: FeaturesConfig) -> OpenCvFeature:
    """ORB (Rublee et al. 2011)."""
    return OpenCvFeature(orb_detector(config), config)


def brisk(config: FeaturesConfig) -> OpenCvFeature:
    """BRISK (Leutenegger, Chli and Siegwart 2011)."""
    return OpenCvFeature(_create("BRISK", thresh=20), config)


class NoVisualFeature:
    """No visual feature: registration by geometry alone."""

    def extract(self, view: View) -> None:
        """Nothing."""

    def match(
        self,
        source: None,  # noqa: ARG002
        target: None,  # noqa: ARG002
    ) -> VisualMatches:
        """No matches."""
        return VisualMatches.empty()
