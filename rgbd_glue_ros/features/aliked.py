"""ALIKED (Zhao et al. 2023): keypoints with descriptors sampled at positions that they predict."""

from __future__ import annotations

from rgbd_glue_ros.features.layers import (
    Tensor,
    Weights,
    batch_norm,
    convolution,
    enlarged,
    unit_in_place,
)
from rgbd_glue_ros.features.learned import LearnedFeature
from rgbd_glue_ros.features.lightglue import matched_by_lightglue
from rgbd_glue_ros.features.score_maps import local_maxima, soft_offsets, strongest
from rgbd_glue_ros.features.torch_library import F, torch
from rgbd_glue_ros.parameters import FeaturesConfig

_STRIDE = 32
"""The network halves an image five times, so its sides are padded to multiples of this."""

_RADIUS = 2
"""Pixels to each side in which a keypoint is unique, and over which its position is averaged."""

_SCORE = 0.2
"""Keypoints below this score are rejected: the authors' default."""

_PATCH = 3
"""Pixels to each side of the patch that predicts a descriptor's sampling positions."""


def aliked_lightglue(config: FeaturesConfig) -> LearnedFeature:
    """ALIKED's keypoints, the model with 16 positions per descriptor, matched by LightGlue."""
    return matched_by_lightglue(aliked_keypoints, "aliked-n16.pth", "aliked_lightglue.pth", config)


def aliked_keypoints(grey: Tensor, w: Weights, most: int) -> tuple[Tensor, Tensor, Tensor]:
    """Keypoints of an image, as in ``Extractor``."""
    score_map, features = aliked((grey / 255).expand(1, 3, *grey.shape), w)
    scores = score_map.float()[0, 0]
    peaks = local_maxima(scores, _RADIUS) & (scores > _SCORE)
    rows, columns = strongest(scores, peaks, most, before=_RADIUS, behind=_RADIUS)
    uv = torch.stack([columns, rows], dim=1) + soft_offsets(scores, rows, columns, _RADIUS)
    found = descriptors(features.float()[0], uv, w.below("desc_head"))
    return uv, found, scores[rows, columns]


def aliked(image: Tensor, w: Weights) -> tuple[Tensor, Tensor]:
    """The part of the network that runs on every pixel.

    Args:
        image: [B, 3, H, W] in [0, 1].
        w: weights of any of the models.

    Returns:
        Scores [B, 1, H, W] in [0, 1] and unit features [B, D, H, W].
    """
    height, width = image.shape[-2:]
    down, right = -height % _STRIDE, -width % _STRIDE
    top, left = down // 2, right // 2
    x = F.pad(image, (left, right - left, top, down - top), mode="replicate")
    size = tuple(x.shape[-2:])
    levels = []
    for number, pooling in ((1, 1), (2, 2), (3, 4), (4, 4)):
        x = _block(F.avg_pool2d(x, pooling), w.below(f"block{number}"))
        level = F.selu(convolution(x, w.below(f"conv{number}")))
        levels.append(enlarged(level, size))
    features = torch.cat(levels, dim=1)
    scores = convolution(features, w.below("score_head", 0))
    for number in (2, 4, 6):
        scores = convolution(F.selu(scores), w.below("score_head", number), padding=1)
    rows, columns = slice(top, top + height), slice(left, left + width)
    return (
        torch.sigmoid(scores[..., rows, columns]),
        unit_in_place(features[..., rows, columns].float()),
    )


def _block(x: Tensor, w: Weights) -> Tensor:
    """Two convolutions; all blocks except the first add a projection of their input."""
    y = F.selu(batch_norm(_convolution(x, w.below("conv1")), w.below("bn1")))
    y = batch_norm(_convolution(y, w.below("conv2")), w.below("bn2"))
    if w.get("downsample.weight") is not None:
        y = y + convolution(x, w.below("downsample"))
    return F.selu(y)


def _convolution(x: Tensor, w: Weights) -> Tensor:
    """A convolution with 3 x 3 weights, deformable if the weights are."""
    if w.get("offset_conv.weight") is None:
        return convolution(x, w, padding=1)
    farthest = max(x.shape[-2:]) / 4
    offsets = convolution(x, w.below("offset_conv"), padding=1).clamp(-farthest, farthest)
    return deformable_convolution(x, offsets, w["regular_conv.weight"])


def deformable_convolution(x: Tensor, offsets: Tensor, weight: Tensor) -> Tensor:
    """A convolution that samples at offsets from its kernel's positions (Dai et al. 2017).

    Args:
        x: [B, C, H, W]; it is 0 outside.
        offsets: [B, 2 K K, H, W], pixels; y and x of each position of the kernel, row by row.
        weight: [O, C, K, K], K odd.

    Returns:
        [B, O, H, W], as a convolution padded by K // 2 gives where offsets are 0.
    """
    batch, channels, height, width = x.shape
    kernel = weight.shape[-1]
    reach = torch.arange(kernel, device=x.device) - kernel // 2
    places = torch.stack(torch.meshgrid(reach, reach, indexing="ij"), dim=-1).reshape(-1, 2)
    pixels = torch.stack(
        torch.meshgrid(
            torch.arange(height, device=x.device),
            torch.arange(width, device=x.device),
            indexing="ij",
        )
    )
    moved = offsets.float().unflatten(1, (-1, 2)) + places[:, :, None, None] + pixels
    size = moved.new_tensor([height - 1, width - 1]).clamp(min=1)
    grid = (moved.movedim(2, -1) / size * 2 - 1).flip(-1)
    seen = F.grid_sample(x.float(), grid.flatten(1, 2), align_corners=True)
    seen = seen.reshape(batch, channels * kernel * kernel, height * width)
    return (weight.flatten(1) @ seen).reshape(batch, -1, height, width)


def descriptors(features: Tensor, uv: Tensor, w: Weights) -> Tensor:
    """Descriptors of keypoints: the features at positions that the patch around each one predicts.

    Args:
        features: [D, H, W].
        uv: [N, 2], pixels.
        w: weights of the descriptor head.

    Returns:
        Unit vectors [N, D].
    """
    height, width = features.shape[1:]
    if len(uv) == 0:
        return features.new_empty((0, len(features)))
    size = uv.new_tensor([width - 1, height - 1])
    # the authors' patch is centred on the pixel below, and ends a pixel before the last
    least = uv.new_tensor([width - 1 - _PATCH, height - 1 - _PATCH])
    corner = (uv.floor() - 1).clamp(min=0).minimum(least).long()
    steps = torch.arange(_PATCH, device=uv.device)
    rows, columns = corner[:, 1, None] + steps, corner[:, 0, None] + steps
    patch = features[:, rows[:, :, None], columns[:, None, :]].transpose(0, 1)
    farthest = max(height, width) / 4
    offsets = F.selu(convolution(patch, w.below("offset_conv", 0)))
    offsets = convolution(offsets, w.below("offset_conv", 2)).clamp(-farthest, farthest)
    # first all x, then all y
    moved = uv[:, None] + offsets.float().flatten(1).unflatten(1, (2, -1)).transpose(1, 2)
    seen = F.grid_sample(features[None], (moved / size * 2 - 1)[None], align_corners=True)
    seen = F.selu(convolution(seen, w.below("sf_conv")))[0]
    return F.normalize(torch.einsum("cnp,pcd->nd", seen, w["agg_weights"]).float(), dim=1)
