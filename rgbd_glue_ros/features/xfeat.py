"""XFeat (Potje et al. 2024): features made for CPUs, matched by its small LightGlue."""

from __future__ import annotations

from rgbd_glue_ros.features.layers import Tensor, Weights, batch_norm, convolution
from rgbd_glue_ros.features.learned import LearnedFeature
from rgbd_glue_ros.features.lightglue import matched_by_lightglue
from rgbd_glue_ros.features.torch_library import F, torch
from rgbd_glue_ros.parameters import FeaturesConfig

_STRIDE = 32
"""The network halves an image five times; images are resized to multiples of this."""

_CELL = 8
"""Side of a cell in which keypoints are distinguished, pixels."""

_SCORE = 0.05
"""Pixels below this are not keypoints: the authors' default."""


def xfeat_lighterglue(config: FeaturesConfig) -> LearnedFeature:
    """XFeat's sparse keypoints, matched by LighterGlue."""
    return matched_by_lightglue(
        xfeat_keypoints, "xfeat.pt", "xfeat-lighterglue.pt", config, "matcher"
    )


def xfeat_keypoints(grey: Tensor, w: Weights, most: int) -> tuple[Tensor, Tensor, Tensor]:
    """Keypoints of an image, as in ``Extractor``."""
    height, width = grey.shape
    inner = height // _STRIDE * _STRIDE, width // _STRIDE * _STRIDE
    image = F.interpolate(grey[None, None], inner, mode="bilinear", align_corners=False)
    maps, logits, reliability = xfeat(image, w)
    uv, scores = _peaks(_heatmap(logits.float()), reliability.float())
    strongest = torch.argsort(scores, descending=True, stable=True)[:most]
    uv = uv[strongest]
    found = F.normalize(_sample(F.normalize(maps.float(), dim=1), uv, inner, "bicubic"), dim=1)
    return uv * uv.new_tensor([width / inner[1], height / inner[0]]), found, scores[strongest]


def xfeat(image: Tensor, w: Weights) -> tuple[Tensor, Tensor, Tensor]:
    """The network.

    Args:
        image: [B, 1, H, W], sides that are multiples of 32; of any brightness.
        w: weights of XFeat.

    Returns:
        Descriptors [B, 64, H/8, W/8], logits of a keypoint at each pixel of a cell, or at none
        [B, 65, H/8, W/8], and reliability [B, 1, H/8, W/8] in [0, 1].
    """
    x = F.instance_norm(image)
    skipped = convolution(F.avg_pool2d(x, 4), w.below("skip1", 1))
    x1 = _layers(x, w.below("block1"), (1, 2, 1, 2))
    x2 = _layers(x1 + skipped, w.below("block2"), (1, 1))
    x3 = _layers(x2, w.below("block3"), (2, 1, 1))
    x4 = _layers(x3, w.below("block4"), (2, 1, 1))
    x5 = _layers(x4, w.below("block5"), (2, 1, 1, 1))
    size = x3.shape[-2:]
    pyramid = x3 + sum(F.interpolate(level, size, mode="bilinear") for level in (x4, x5))
    fused = convolution(
        _layers(pyramid, w.below("block_fusion"), (1, 1)), w.below("block_fusion", 2)
    )
    reliability = _head(fused, w.below("heatmap_head"), 2)
    cells = F.pixel_unshuffle(x, _CELL)
    return fused, _head(cells, w.below("keypoint_head"), 3), torch.sigmoid(reliability)


def _layers(x: Tensor, w: Weights, strides: tuple[int, ...]) -> Tensor:
    """Convolutions, each with normalisation and rectifier."""
    for i, stride in enumerate(strides):
        layer = w.below(i, "layer")
        padding = layer["0.weight"].shape[-1] // 2
        x = convolution(x, layer.below(0), stride, padding)
        x = F.relu(batch_norm(x, layer.below(1)))
    return x


def _head(x: Tensor, w: Weights, layers: int) -> Tensor:
    return convolution(_layers(x, w, (1,) * layers), w.below(layers))


def _heatmap(logits: Tensor) -> Tensor:
    """The probability of a keypoint at each pixel, [1, 1, H, W]."""
    return F.pixel_shuffle(F.softmax(logits, dim=1)[:, :-1], _CELL)


def _peaks(heatmap: Tensor, reliability: Tensor) -> tuple[Tensor, Tensor]:
    """The maxima of their 5 x 5 pixels, [N, 2], and their scores [N]."""
    size = heatmap.shape[-2:]
    greatest = F.max_pool2d(heatmap, 5, stride=1, padding=2)
    uv = torch.nonzero((heatmap == greatest) & (heatmap > _SCORE))[:, [3, 2]].float()
    scores = _sample(heatmap, uv, size, "nearest") * _sample(reliability, uv, size, "bilinear")
    # a score of 0 is not a keypoint, and at the corner the authors use none
    kept = (scores[:, 0] > 0) & (uv != 0).any(dim=1)
    return uv[kept], scores[kept, 0]


def _sample(maps: Tensor, uv: Tensor, size: tuple[int, int], mode: str) -> Tensor:
    """Maps [1, D, h, w] at pixels [N, 2] of an image of a size (H, W): [N, D].

    The authors take the outermost pixels' centres as the borders of the map, which their training
    relies on.
    """
    grid = (2 * uv / uv.new_tensor([size[1] - 1, size[0] - 1]) - 1)[None, None]
    return F.grid_sample(maps, grid, mode=mode, align_corners=False)[0, :, 0].T
