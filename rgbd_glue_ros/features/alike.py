"""ALIKE (Zhao et al. 2022): a small network for keypoints and descriptors, matched mutually."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.features.layers import (
    Tensor,
    Weights,
    batch_norm,
    convolution,
    enlarged,
    unit_in_place,
)
from rgbd_glue_ros.features.matching import distance_ratio, nearest_two
from rgbd_glue_ros.features.score_maps import local_maxima, sample, soft_offsets, strongest
from rgbd_glue_ros.features.torch_library import F, device_of, inference, torch
from rgbd_glue_ros.features.visual import DescribedKeypoints, VisualMatches
from rgbd_glue_ros.features.weights import load
from rgbd_glue_ros.geometry.contrast import well_lit
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.types import Float32, View

_RADIUS = 2
"""Pixels to each side in which a keypoint is unique, and over which its position is averaged."""

_SCORE = 0.2
"""Keypoints below this score are rejected, as in the authors' demonstration."""

_STRIDE = 32
"""The network halves an image five times, so its sides are padded to multiples of this."""


class Alike:
    """Keypoints and descriptors of ALIKE; mutual nearest neighbours.

    Args:
        config: of the features.
        file: weights of the tiny or the normal model.
    """

    def __init__(self, config: FeaturesConfig, file: str = "alike_t.pth") -> None:
        self._device = device_of(config.device)
        self._weights = load(file, config, self._device)
        self._most = config.keypoints

    def extract(self, view: View) -> DescribedKeypoints:
        """The keypoints with the highest scores."""
        with inference(self._device):
            image = torch.from_numpy(well_lit(view)).to(self._device).float() / 255
            scores, descriptors = alike(image.expand(1, 3, *image.shape), self._weights)
            uv, descriptors_at = keypoints(scores.float()[0, 0], descriptors.float()[0], self._most)
        return DescribedKeypoints(uv.cpu().numpy(), descriptors_at.cpu().numpy())

    def keypoints(self, features: DescribedKeypoints) -> Float32:
        """Pixels, float32 [N, 2]."""
        return features.uv

    def match(self, source: DescribedKeypoints, target: DescribedKeypoints) -> VisualMatches:
        """Mutual nearest neighbours, weighted by 1 - r of equation 1."""
        if len(source.uv) < 2 or len(target.uv) < 2:
            return VisualMatches.empty()
        forth, distances = nearest_two(source.descriptors, target.descriptors)
        back, _ = nearest_two(target.descriptors, source.descriptors)
        kept = np.flatnonzero(back[forth] == np.arange(len(forth)))
        weights = 1.0 - distance_ratio(distances[kept])
        return VisualMatches(source.uv[kept], target.uv[forth[kept]], weights)


def alike(image: Tensor, w: Weights) -> tuple[Tensor, Tensor]:
    """The network.

    Args:
        image: [B, 3, H, W] in [0, 1].
        w: weights of a model with one head (tiny, small or normal).

    Returns:
        Scores [B, 1, H, W] in [0, 1] and unit descriptors [B, D, H, W] of every pixel.
    """
    height, width = image.shape[-2:]
    x = F.pad(image, (0, -width % _STRIDE, 0, -height % _STRIDE))
    size = tuple(x.shape[-2:])
    levels = []
    for number, pooling in ((1, 1), (2, 2), (3, 4), (4, 4)):
        x = _block(F.max_pool2d(x, pooling), w.below(f"block{number}"))
        level = F.relu(convolution(x, w.below(f"conv{number}")))
        levels.append(enlarged(level, size))
    x = convolution(torch.cat(levels, dim=1), w.below("convhead2"))[..., :height, :width]
    return torch.sigmoid(x[:, -1:]), unit_in_place(x[:, :-1].float())


def _block(x: Tensor, w: Weights) -> Tensor:
    """Two convolutions; all blocks except the first add a projection of their input."""
    y = F.relu(batch_norm(convolution(x, w.below("conv1"), padding=1), w.below("bn1")))
    y = batch_norm(convolution(y, w.below("conv2"), padding=1), w.below("bn2"))
    if w.get("downsample.weight") is not None:
        y = y + convolution(x, w.below("downsample"))
    return F.relu(y)


def keypoints(scores: Tensor, descriptors: Tensor, most: int) -> tuple[Tensor, Tensor]:
    """Local maxima of the scores between pixels, the highest first, and their descriptors.

    Args:
        scores: [H, W].
        descriptors: [D, H, W].
        most: maximum number of keypoints.

    Returns:
        Pixels [N, 2] and unit descriptors [N, D].
    """
    if min(scores.shape) <= 2 * _RADIUS + 1:
        return scores.new_empty((0, 2)), scores.new_empty((0, len(descriptors)))
    peaks = local_maxima(scores, _RADIUS) & (scores > _SCORE)
    # the window around a keypoint lies in the image
    rows, columns = strongest(scores, peaks, most, before=_RADIUS + 1, behind=_RADIUS)
    uv = torch.stack([columns, rows], dim=1) + soft_offsets(scores, rows, columns, _RADIUS)
    return uv, F.normalize(sample(descriptors, uv), dim=1)
