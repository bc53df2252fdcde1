"""Layers of neural networks as functions of an input and weights.

A network here is a function, its weights a table of tensors with the names that their authors gave
them. So checkpoints are read as published, and nothing holds state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rgbd_glue_ros.features.torch_library import F

Tensor = Any
"""A ``torch.Tensor``; torch is optional, and so are its types."""


@dataclass(frozen=True)
class Weights:
    """The weights of a network: tensors by name, or those below one name.

    Attributes:
        tensors: of the whole network.
        prefix: precedes every name, "" or ending in a dot.
    """

    tensors: Mapping[str, Tensor]
    prefix: str = ""

    def __getitem__(self, name: str) -> Tensor:
        return self.tensors[self.prefix + name]

    def get(self, name: str) -> Tensor | None:
        """The tensor of that name, or None: not every layer has a bias."""
        return self.tensors.get(self.prefix + name)

    def below(self, *names: str | int) -> Weights:
        """The weights of a part: ``below("block1", 0)`` gives those that begin with block1.0."""
        return Weights(self.tensors, self.prefix + "".join(f"{name}." for name in names))


def convolution(x: Tensor, w: Weights, stride: int = 1, padding: int = 0) -> Tensor:
    """A 2D convolution of images [B, C, H, W]."""
    return F.conv2d(x, w["weight"], w.get("bias"), stride, padding)


def batch_norm(x: Tensor, w: Weights) -> Tensor:
    """Batch normalisation by the statistics of the training, channels second."""
    return F.batch_norm(x, w["running_mean"], w["running_var"], w.get("weight"), w.get("bias"))


def linear(x: Tensor, w: Weights) -> Tensor:
    """A linear map of the last dimension."""
    return F.linear(x, w["weight"], w.get("bias"))


def layer_norm(x: Tensor, w: Weights) -> Tensor:
    """Layer normalisation of the last dimension."""
    return F.layer_norm(x, x.shape[-1:], w["weight"], w["bias"])


def enlarged(x: Tensor, size: tuple[int, int]) -> Tensor:
    """Images [B, C, h, w] in another size (H, W), bilinear, the outermost pixels' centres kept."""
    if tuple(x.shape[-2:]) == size:
        return x
    return F.interpolate(x, size, mode="bilinear", align_corners=True)


def unit_in_place(x: Tensor) -> Tensor:
    """Images [B, C, H, W] whose channels are made a unit vector in each pixel.

    A few channels at a time stay in the cache, and none is copied: a seventh of the time.
    """
    squares = sum(part.square().sum(dim=1, keepdim=True) for part in x.split(16, dim=1))
    return x.mul_(squares.clamp(min=1e-24).rsqrt())
