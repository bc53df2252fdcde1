"""FCGF: fully convolutional geometric features (Choy, Park and Koltun, ICCV 2019).

A sparse U-net over the voxels of a cloud, ResUNetBN2C as its authors call it, describes every voxel
by its surroundings within a metre.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.features.geometric import DescribedPoints, TransformPrior, nearest_matches
from rgbd_glue_ros.features.layers import Tensor, Weights, batch_norm
from rgbd_glue_ros.features.sparse_convolution import (
    Grid,
    Pairs,
    convolve,
    convolve_occupancy,
    edge,
    pairs,
)
from rgbd_glue_ros.features.torch_library import F, device_of, inference, torch
from rgbd_glue_ros.features.voxels import group_means
from rgbd_glue_ros.features.weights import load, weights_folder
from rgbd_glue_ros.geometry.camera import cloud
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.types import Correspondences, View

FILE = "2019-08-19_06-17-41.pth"
"""The checkpoint that its authors trained on 3DMatch, with voxels of 2.5 cm."""

_DIMENSIONS = 32
_ENCODER = (32, 64, 128, 256)
_DECODER = (64, 64, 128)
"""Channels of each level, from the finest to the coarsest; the coarsest is only in the encoder."""

_SIZE = 3
"""Size of every kernel except the first, and those of the last two layers, which see one voxel."""


class Fcgf:
    """Voxels described by FCGF."""

    def __init__(self, config: FeaturesConfig) -> None:
        self._device = device_of(config.device)
        self._weights = load(FILE, config, self._device)
        check_architecture(self._weights, weights_folder(config) / FILE)
        self._voxel = config.voxel
        self._most = config.geometric_matches

    def extract(self, view: View) -> DescribedPoints:
        """Thins the cloud to one point per voxel and describes each."""
        points = cloud(view.depth, view.intrinsics)
        if not len(points):
            return DescribedPoints(points, np.empty((0, _DIMENSIONS), np.float32))
        grid, number = Grid.of(torch.from_numpy(np.floor(points / self._voxel).astype(np.int64)))
        grid = grid.to(self._device)
        with inference(self._device):
            descriptors = describe(grid, self._weights)
        means = group_means(points, number.numpy())
        return DescribedPoints(means, descriptors.float().cpu().numpy())

    def match(
        self,
        source: DescribedPoints,
        target: DescribedPoints,
        prior: TransformPrior | None,  # noqa: ARG002 - the paper matches first and filters after
    ) -> Correspondences:
        """Section 3.1."""
        return nearest_matches(source.thinned(self._most), target)


def shapes(first_size: int) -> dict[str, tuple[int, ...]]:
    """Names and shapes of all weights of ResUNetBN2C, for a size of its first kernel."""
    found: dict[str, tuple[int, ...]] = {}

    def add(name: str, kernel: tuple[int, ...], norm: str) -> None:
        found[f"{name}.kernel"] = kernel
        for part in ("weight", "bias", "running_mean", "running_var"):
            found[f"{norm}.bn.{part}"] = kernel[-1:]

    def add_block(name: str, channels: int) -> None:
        for layer in (1, 2):
            kernel = (_SIZE**3, channels, channels)
            add(f"{name}.conv{layer}", kernel, f"{name}.norm{layer}")

    channels, size = 1, first_size
    for level, width in enumerate(_ENCODER, start=1):
        add(f"conv{level}", (size**3, channels, width), f"norm{level}")
        add_block(f"block{level}", width)
        channels, size = width, _SIZE
    for level in range(len(_ENCODER), 1, -1):
        width = _DECODER[level - 2]
        add(f"conv{level}_tr", (_SIZE**3, channels, width), f"norm{level}_tr")
        add_block(f"block{level}_tr", width)
        channels = width + _ENCODER[level - 2]
    found["conv1_tr.kernel"] = (channels, _DECODER[0])
    found["final.kernel"] = (_DECODER[0], _DIMENSIONS)
    found["final.bias"] = (1, _DIMENSIONS)
    return found


def check_architecture(w: Weights, source: Path) -> None:
    """Compares weights with the network.

    Raises:
        InputError: the weights belong to another network.
    """
    first = w.get("conv1.kernel")
    size = 0 if first is None else edge(first)
    for name, shape in shapes(size).items():
        tensor = w.get(name)
        if tensor is None or tensor.shape != shape:
            has = "missing" if tensor is None else f"of shape {[*tensor.shape]}"
            raise InputError(
                source, f"is not FCGF's ResUNetBN2C ({name} is {has})", f"give its {FILE}"
            )


@dataclass(frozen=True)
class _Level:
    """Which cells of a grid, and of the coarser one, are paired in the layers of the network.

    Attributes:
        within: within the grid.
        down: to the coarser grid.
        up: from the coarser grid.
        coarse: within the coarser grid.
    """

    within: Pairs
    down: Pairs
    up: Pairs
    coarse: Pairs


def _levels(grid: Grid) -> list[_Level]:
    """All levels but the coarsest, from the finest on."""
    levels = []
    within = pairs(grid, grid, _SIZE)
    for _ in _DECODER:
        coarser = grid.coarser()
        coarse = pairs(coarser, coarser, _SIZE)
        down, up = pairs(coarser, grid, _SIZE), pairs(grid, coarser, _SIZE)
        levels.append(_Level(within, down, up, coarse))
        grid, within = coarser, coarse
    return levels


def describe(grid: Grid, w: Weights) -> Tensor:
    """The network.

    Args:
        grid: the voxels that contain a point.
        w: weights of ResUNetBN2C, with its authors' names.

    Returns:
        Unit descriptors [N, 32].
    """
    levels = _levels(grid)
    x = convolve_occupancy(w["conv1.kernel"], grid)
    x = _block(_normalised(x, w.below("norm1")), w.below("block1"), levels[0].within)
    finer = []
    for number, level in enumerate(levels, start=2):
        finer.append(x)
        x = _normalised(
            convolve(x, w[f"conv{number}.kernel"], level.down), w.below(f"norm{number}")
        )
        x = _block(x, w.below(f"block{number}"), level.coarse)
    for number, level in reversed([*enumerate(levels, start=2)]):
        x = convolve(x, w[f"conv{number}_tr.kernel"], level.up)
        x = _normalised(x, w.below(f"norm{number}_tr"))
        x = _block(x, w.below(f"block{number}_tr"), level.within)
        x = torch.cat([x, finer.pop()], dim=1)
    x = F.relu(x @ w["conv1_tr.kernel"]) @ w["final.kernel"] + w["final.bias"]
    return F.normalize(x, dim=1)


def _block(x: Tensor, w: Weights, within: Pairs) -> Tensor:
    """Two convolutions with a residual connection."""
    y = F.relu(_normalised(convolve(x, w["conv1.kernel"], within), w.below("norm1")))
    y = _normalised(convolve(y, w["conv2.kernel"], within), w.below("norm2"))
    return F.relu(x + y)


def _normalised(x: Tensor, w: Weights) -> Tensor:
    return batch_norm(x, w.below("bn"))
