"""Learned visual features: one network finds and describes keypoints, another matches them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rgbd_glue_ros.features.layers import Tensor, Weights
from rgbd_glue_ros.features.torch_library import inference, torch
from rgbd_glue_ros.features.visual import VisualMatches
from rgbd_glue_ros.geometry.contrast import well_lit
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.types import Float32, View

_SMALLEST_IMAGE_PX = 32
"""The networks halve an image up to five times; nothing would remain of a smaller one."""


@dataclass(frozen=True)
class LearnedKeypoints:
    """Keypoints and descriptors on the device that computed them.

    Attributes:
        uv: [N, 2], pixels.
        descriptors: [N, D], unit vectors.
        scores: [N], strength of each keypoint, in units of its network.
        width: of the image, pixels.
        height: of the image, pixels.
    """

    uv: Tensor
    descriptors: Tensor
    scores: Tensor
    width: int
    height: int


class Extractor(Protocol):
    """A function that detects and describes keypoints with a network."""

    def __call__(self, grey: Tensor, w: Weights, most: int) -> tuple[Tensor, Tensor, Tensor]:
        """Keypoints of an image.

        Args:
            grey: [H, W], 0 to 255.
            w: weights of the network.
            most: maximum number of keypoints.

        Returns:
            Pixels [N, 2], unit descriptors [N, D] and
                scores [N], the highest first.
        """


class Matcher(Protocol):
    """A network that matches keypoints."""

    def __call__(self, source: LearnedKeypoints, target: LearnedKeypoints) -> Tensor:
        """The logarithm of the probability that keypoints match, [N, M]; neither is empty."""


def most_keypoints(config: FeaturesConfig) -> int:
    """Keypoints passed to a matcher, at most: its time grows with their square."""
    return min(config.keypoints, config.matcher_keypoints)


@dataclass(frozen=True)
class LearnedFeature:
    """A visual feature made of two networks; no ratio test (section 3.1).

    Attributes:
        extractor: finds and describes keypoints.
        weights: weights of the extractor.
        matcher: matches them.
        confidence: minimum confidence of matches.
        most: keypoints, at most.
        device: where it is computed.
    """

    extractor: Extractor
    weights: Weights
    matcher: Matcher
    confidence: float
    most: int
    device: Any

    def extract(self, view: View) -> LearnedKeypoints:
        """The keypoints with the highest scores; an image of a few pixels has none."""
        height, width = view.grey.shape
        with inference(self.device):
            if min(height, width) < _SMALLEST_IMAGE_PX:
                nothing = torch.empty((0, 2), device=self.device)
                return LearnedKeypoints(nothing, nothing, nothing[:, 0], width, height)
            grey = torch.from_numpy(well_lit(view)).to(self.device).float()
            uv, descriptors, scores = self.extractor(grey, self.weights, self.most)
        return LearnedKeypoints(uv, descriptors, scores, width, height)

    def keypoints(self, features: LearnedKeypoints) -> Float32:
        """Pixels, float32 [N, 2]."""
        return _pixels(features.uv)

    def match(self, source: LearnedKeypoints, target: LearnedKeypoints) -> VisualMatches:
        """Matches one to one, weighted by the matcher's confidence."""
        if len(source.uv) == 0 or len(target.uv) == 0:
            return VisualMatches.empty()
        with inference(self.device):
            log_probability = self.matcher(source, target)
            rows, columns, confidence = mutual(log_probability, self.confidence)
        return VisualMatches(
            _pixels(source.uv[rows]),
            _pixels(target.uv[columns]),
            confidence.cpu().numpy().astype(np.float64).clip(0.0, 1.0),
        )


def _pixels(uv: Tensor) -> Float32:
    return np.asarray(uv.cpu().numpy(), np.float32)


def mutual(log_probability: Tensor, least: float) -> tuple[Tensor, Tensor, Tensor]:
    """Rows and columns of the entries that are greatest in both, and their probabilities.

    Args:
        log_probability: [N, M], of matches.
        least: minimum probability of a match.
    """
    best, columns = log_probability.max(dim=1)
    back = log_probability.argmax(dim=0)
    confidence = best.float().exp()
    every = torch.arange(len(columns), device=columns.device)
    rows = torch.nonzero((back[columns] == every) & (confidence > least))[:, 0]
    return rows, columns[rows], confidence[rows]
