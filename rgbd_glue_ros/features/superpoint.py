"""SuperPoint (DeTone, Malisiewicz and Rabinovich 2018), matched by LightGlue or SuperGlue.

Its weights and SuperGlue's may be used for research only and not be redistributed, so they are read
from where the user has put them.
"""

from __future__ import annotations

from functools import partial

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.features import superglue
from rgbd_glue_ros.features.layers import Tensor, Weights, convolution
from rgbd_glue_ros.features.learned import LearnedFeature, LearnedKeypoints, most_keypoints
from rgbd_glue_ros.features.lightglue import matched_by_lightglue
from rgbd_glue_ros.features.score_maps import local_maxima, strongest
from rgbd_glue_ros.features.torch_library import F, device_of, torch
from rgbd_glue_ros.features.weights import load, weights_folder
from rgbd_glue_ros.parameters import FeaturesConfig

_FILE = "superpoint_v1.pth"

_CHANNELS = 256
"""Channels of a descriptor."""

_CELL = 8
"""Side of a cell in which keypoints are distinguished, pixels."""

_RADIUS = 4
"""Pixels to each side in which a keypoint is unique, and from the border to the first."""

_SCORE_FOR_LIGHTGLUE, _SCORE_FOR_SUPERGLUE = 0.0005, 0.005
"""Pixels below this are not keypoints: the value of the matchers' authors."""


def superpoint_lightglue(config: FeaturesConfig) -> LearnedFeature:
    """SuperPoint's keypoints, matched by LightGlue."""
    extractor = partial(superpoint_keypoints, least=_SCORE_FOR_LIGHTGLUE)
    feature = matched_by_lightglue(extractor, _FILE, "superpoint_lightglue.pth", config)
    _try_out(feature, config)
    return feature


def _try_out(feature: LearnedFeature, config: FeaturesConfig) -> None:
    """Refuses weights of another network, since the checksum of LightGlue's is not known.

    Raises:
        InputError: the weights belong to another network.
    """
    one = torch.ones((1, _CHANNELS), device=feature.device)
    keypoint = LearnedKeypoints(one[:, :2], one, one[:, 0], _CELL, _CELL)
    try:
        feature.match(keypoint, keypoint)
    except (KeyError, RuntimeError) as error:
        raise InputError(
            f"weights superpoint_lightglue.pth in {weights_folder(config)}",
            "are not those of a LightGlue for SuperPoint",
            "give the file that its authors publish",
        ) from error


def superpoint_superglue(config: FeaturesConfig) -> LearnedFeature:
    """SuperPoint's keypoints, matched by SuperGlue trained indoors."""
    device = device_of(config.device)
    return LearnedFeature(
        partial(superpoint_keypoints, least=_SCORE_FOR_SUPERGLUE),
        load(_FILE, config, device),
        superglue.SuperGlue(load("superglue_indoor.pth", config, device)),
        superglue.CONFIDENCE,
        most_keypoints(config),
        device,
    )


def superpoint_keypoints(
    grey: Tensor, w: Weights, most: int, *, least: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Keypoints of an image with scores above ``least``, as in ``Extractor``."""
    logits, features = superpoint((grey / 255)[None, None], w)
    scores = F.pixel_shuffle(F.softmax(logits.float(), dim=1)[:, :-1], _CELL)[0, 0]
    peaks = local_maxima(scores, _RADIUS) & (scores > least)
    rows, columns = strongest(scores, peaks, most, before=_RADIUS, behind=_RADIUS)
    uv = torch.stack([columns, rows], dim=1).float()
    return uv, _sample(F.normalize(features.float(), dim=1), uv), scores[rows, columns]


def superpoint(image: Tensor, w: Weights) -> tuple[Tensor, Tensor]:
    """The network.

    Args:
        image: [B, 1, H, W] in [0, 1].
        w: weights of SuperPoint.

    Returns:
        Logits of a keypoint at each pixel of a cell, or at none, [B, 65, H // 8, W // 8], and
        features [B, D, H // 8, W // 8].
    """
    x = image
    for number in (1, 2, 3, 4):
        if number > 1:
            x = F.max_pool2d(x, 2)
        for half in "ab":
            x = F.relu(convolution(x, w.below(f"conv{number}{half}"), padding=1))
    return _head(x, w, "P"), _head(x, w, "D")


def _head(x: Tensor, w: Weights, name: str) -> Tensor:
    x = F.relu(convolution(x, w.below(f"conv{name}a"), padding=1))
    return convolution(x, w.below(f"conv{name}b"))


def _sample(maps: Tensor, uv: Tensor) -> Tensor:
    """Unit vectors of maps of cells [1, D, h, w] at pixels [N, 2], [N, D].

    The authors stretch the cells' centres a little, which their training relies on.
    """
    height, width = maps.shape[-2:]
    centre = (_CELL - 1) / 2
    extent = uv.new_tensor([width, height]) * _CELL - centre - 1
    grid = ((uv - centre) / extent * 2 - 1)[None, None]
    found = F.grid_sample(maps, grid, mode="bilinear", align_corners=True)[0, :, 0].T
    return F.normalize(found, dim=1)
