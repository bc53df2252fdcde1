"""Numbers in the place of what FCGF learned: its checkpoint is not to be had for tests."""

from __future__ import annotations

from math import prod
from pathlib import Path
from typing import Any

from rgbd_glue_ros.features.fcgf import FILE, shapes
from rgbd_glue_ros.features.torch_library import torch

FIRST_SIZE = 7
"""Of the first kernel in the published checkpoint for 3DMatch."""


def random_weights(seed: int = 0, first_size: int = FIRST_SIZE) -> dict[str, Any]:
    """Tensors of the names and shapes of ResUNetBN2C, which keep activations near 1."""
    random = torch.Generator().manual_seed(seed)
    tensors = {}
    for name, shape in shapes(first_size).items():
        tensor = torch.randn(shape, generator=random)
        if name.endswith("kernel"):
            # of a kernel's cells about a third are occupied on a surface
            tensor *= (6 / prod(shape[:-1])) ** 0.5
        elif name.endswith(("running_var", "weight")):
            tensor = 1 + 0.1 * tensor.abs()
        else:
            tensor *= 0.1
        tensors[name] = tensor
    return tensors


def write_random_fcgf(folder: Path) -> Path:
    """A checkpoint of them by the published name, once."""
    path = folder / FILE
    if not path.exists():
        torch.save({"state_dict": random_weights()}, path)
    return path
