"""DISK (Tyszkiewicz, Fua and Trulls 2020): keypoints and descriptors of one U-Net."""

from __future__ import annotations

from rgbd_glue_ros.features.layers import Tensor, Weights, convolution
from rgbd_glue_ros.features.learned import LearnedFeature
from rgbd_glue_ros.features.lightglue import matched_by_lightglue
from rgbd_glue_ros.features.score_maps import greatest_around, strongest
from rgbd_glue_ros.features.torch_library import F, torch
from rgbd_glue_ros.parameters import FeaturesConfig

_STRIDE = 16
"""The network halves an image four times, so its sides are padded to multiples of this."""

_RADIUS = 2
"""Pixels to each side in which a keypoint has the highest score."""


def disk_lightglue(config: FeaturesConfig) -> LearnedFeature:
    """DISK's keypoints, of the model that was trained with depth, matched by LightGlue."""
    return matched_by_lightglue(disk_keypoints, "disk-depth-save.pth", "disk_lightglue.pth", config)


def disk_keypoints(grey: Tensor, w: Weights, most: int) -> tuple[Tensor, Tensor, Tensor]:
    """Keypoints of an image, as in ``Extractor``."""
    score_map, features = disk((grey / 255).expand(1, 3, *grey.shape), w)
    scores = score_map.float()[0, 0]
    peaks = (scores == greatest_around(scores, _RADIUS)) & (scores > 0)
    rows, columns = strongest(scores, peaks, most)
    found = F.normalize(features[0, :, rows, columns].float().T, dim=1)
    return torch.stack([columns, rows], dim=1).float(), found, scores[rows, columns]


def disk(image: Tensor, w: Weights) -> tuple[Tensor, Tensor]:
    """The network.

    Args:
        image: [B, 3, H, W] in [0, 1].
        w: weights of DISK.

    Returns:
        Scores [B, 1, H, W], positive where a keypoint may be, and features [B, D, H, W].
    """
    height, width = image.shape[-2:]
    x = F.pad(image, (0, -width % _STRIDE, 0, -height % _STRIDE))
    levels = [_gated_convolution(x, w.below("unet", "path_down", 0, 1))]
    for number in range(1, 5):
        half = F.avg_pool2d(levels[-1], 2)
        levels.append(_gated_convolution(half, w.below("unet", "path_down", number, 1)))
    y = levels.pop()
    for number, level in enumerate(reversed(levels)):
        double = F.interpolate(y, scale_factor=2, mode="bilinear", align_corners=False)
        y = _gated_convolution(
            torch.cat([double, level], dim=1), w.below("unet", "path_up", number, "conv")
        )
    y = y[..., :height, :width]
    return y[:, -1:], y[:, :-1]


def _gated_convolution(x: Tensor, w: Weights) -> Tensor:
    """A convolution with 5 x 5 weights; all but the first normalise and rectify their input."""
    if w.get("1.weight") is not None:
        x = F.prelu(F.instance_norm(x), w["1.weight"])
    return convolution(x, w.below(3), padding=2)
