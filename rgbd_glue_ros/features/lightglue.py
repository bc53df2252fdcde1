"""LightGlue (Lindenberger, Sarlin and Pollefeys 2023): a transformer that matches keypoints."""

from __future__ import annotations

import re

from rgbd_glue_ros.features.layers import Tensor, Weights, layer_norm, linear
from rgbd_glue_ros.features.learned import (
    Extractor,
    LearnedFeature,
    LearnedKeypoints,
    most_keypoints,
)
from rgbd_glue_ros.features.torch_library import F, device_of, torch
from rgbd_glue_ros.features.weights import load
from rgbd_glue_ros.parameters import FeaturesConfig

CONFIDENCE = 0.1
"""Matches below this confidence are rejected: the authors' default."""


class LightGlue:
    """The matcher, without the pruning of points and layers that its authors offer for speed.

    So its time depends on the number of keypoints alone, and every match has seen every keypoint.
    """

    def __init__(self, weights: Weights) -> None:
        self._weights = named_as_today(weights)

    def __call__(self, source: LearnedKeypoints, target: LearnedKeypoints) -> Tensor:
        """The logarithm of the probability that keypoints match, [N, M]."""
        return log_assignment(source, target, self._weights)


def matched_by_lightglue(
    extractor: Extractor, extractor_file: str, matcher_file: str, config: FeaturesConfig, *part: str
) -> LearnedFeature:
    """An extractor's keypoints, matched by the LightGlue that was trained for them.

    Args:
        extractor: detects and describes them.
        extractor_file: its weights in the catalogue.
        matcher_file: LightGlue's weights.
        config: of the features.
        part: the part of the matcher's file with LightGlue; none for all of it.

    Raises:
        InputError: weights are missing, damaged, or not the published ones.
        MissingExtraError: torch is not installed.
    """
    device = device_of(config.device)
    matcher = LightGlue(load(matcher_file, config, device).below(*part))
    weights = load(extractor_file, config, device)
    most = most_keypoints(config)
    return LearnedFeature(extractor, weights, matcher, CONFIDENCE, most, device)


def named_as_today(w: Weights) -> Weights:
    """The weights with the names of the authors' current code: checkpoints may have older ones."""
    before = re.compile(r"^(self_attn|cross_attn)\.(\d+)\.")
    names = (name for name in w.tensors if name.startswith(w.prefix))
    return Weights(
        {
            before.sub(r"transformers.\2.\1.", name.removeprefix(w.prefix)): w.tensors[name]
            for name in names
        }
    )


def log_assignment(source: LearnedKeypoints, target: LearnedKeypoints, w: Weights) -> Tensor:
    """The network: the logarithm of the probability that keypoints match.

    Args:
        source: N keypoints.
        target: M keypoints.
        w: weights of LightGlue, with its authors' current names.

    Returns:
        [N, M].
    """
    sets = [
        (_projected(points.descriptors, w), _rotation(points, w)) for points in (source, target)
    ]
    (x0, r0), (x1, r1) = sets
    # a head is as wide as the encoding of a position
    heads = x0.shape[-1] // r0[0].shape[-1]
    for layer in range(_layers(w)):
        block = w.below("transformers", layer)
        x0 = _self_attention(x0, r0, block.below("self_attn"), heads)
        x1 = _self_attention(x1, r1, block.below("self_attn"), heads)
        x0, x1 = _cross_attention(x0, x1, block.below("cross_attn"), heads)
    return _assignment(x0.float(), x1.float(), w.below("log_assignment", layer))


def _layers(w: Weights) -> int:
    """The number of layers."""
    count = 0
    while w.get(f"transformers.{count}.self_attn.Wqkv.weight") is not None:
        count += 1
    return count


def _projected(descriptors: Tensor, w: Weights) -> Tensor:
    """Descriptors projected to the width of the network; unchanged if they have it."""
    if w.get("input_proj.weight") is None:
        return descriptors
    return linear(descriptors, w.below("input_proj"))


def _rotation(points: LearnedKeypoints, w: Weights) -> tuple[Tensor, Tensor]:
    """Cosines and sines [N, d] that rotate queries and keys by the position of their keypoints."""
    size = points.uv.new_tensor([points.width, points.height])
    centred = (points.uv - size / 2) / (size.max() / 2)
    angle = linear(centred, w.below("posenc", "Wr")).repeat_interleave(2, dim=-1)
    return angle.cos(), angle.sin()


def _turned(x: Tensor, rotation: tuple[Tensor, Tensor]) -> Tensor:
    """Rotates pairs of neighbouring channels as points of a plane."""
    cosine, sine = rotation
    pairs = x.unflatten(-1, (-1, 2))
    quarter = torch.stack([-pairs[..., 1], pairs[..., 0]], dim=-1).flatten(-2)
    return x * cosine + quarter * sine


def _self_attention(x: Tensor, rotation: tuple[Tensor, Tensor], w: Weights, heads: int) -> Tensor:
    # queries, keys and values are interleaved in the last dimension
    qkv = linear(x, w.below("Wqkv")).unflatten(-1, (heads, -1, 3)).transpose(0, 1)
    q, k, v = (qkv[..., i] for i in range(3))
    seen = F.scaled_dot_product_attention(_turned(q, rotation), _turned(k, rotation), v)
    return _updated(x, linear(_joined(seen), w.below("out_proj")), w.below("ffn"))


def _cross_attention(x0: Tensor, x1: Tensor, w: Weights, heads: int) -> tuple[Tensor, Tensor]:
    """Each set attends to the other; one similarity serves both directions."""
    (qk0, v0), (qk1, v1) = (
        tuple(
            linear(x, w.below(name)).unflatten(-1, (heads, -1)).transpose(0, 1)
            for name in ("to_qk", "to_v")
        )
        for x in (x0, x1)
    )
    seen0 = F.scaled_dot_product_attention(qk0, qk1, v1)
    seen1 = F.scaled_dot_product_attention(qk1, qk0, v0)
    return (
        _updated(x0, linear(_joined(seen0), w.below("to_out")), w.below("ffn")),
        _updated(x1, linear(_joined(seen1), w.below("to_out")), w.below("ffn")),
    )


def _joined(x: Tensor) -> Tensor:
    """Heads [h, N, d] side by side, [N, h d]."""
    return x.transpose(0, 1).flatten(-2)


def _updated(x: Tensor, message: Tensor, w: Weights) -> Tensor:
    y = linear(torch.cat([x, message], dim=-1), w.below(0))
    return x + linear(F.gelu(layer_norm(y, w.below(1))), w.below(3))


def _assignment(x0: Tensor, x1: Tensor, w: Weights) -> Tensor:
    """Softmax over rows and over columns, times how matchable each keypoint is."""
    scale = x0.shape[-1] ** 0.25
    m0, m1 = (linear(x, w.below("final_proj")) / scale for x in (x0, x1))
    similarity = m0 @ m1.T
    z0, z1 = (F.logsigmoid(linear(x, w.below("matchability"))) for x in (x0, x1))
    return F.log_softmax(similarity, dim=1) + F.log_softmax(similarity, dim=0) + z0 + z1.T
