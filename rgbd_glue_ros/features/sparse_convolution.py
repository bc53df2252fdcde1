"""Convolutions of grids with few occupied cells (Choy, Gwak and Savarese, CVPR 2019).

As defined by MinkowskiEngine: an output sees the occupied inputs, and a transposed convolution
writes where the finer grid had cells. The pairs of inputs and outputs are found once for a pair of
grids, and serve every layer between the two.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from rgbd_glue_ros.features.layers import Tensor
from rgbd_glue_ros.features.torch_library import torch

_COARSEST = 8
"""Maximum step of a grid. Borders have this width, so that no neighbour of a cell wraps around."""

_BEYOND = 2**62
"""Larger than every key."""


@dataclass(frozen=True)
class Grid:
    """Occupied cells.

    Attributes:
        keys: int64 [N], increasing: x + width * (y + height * z), from a corner of the grid.
        width: cells along x.
        height: cells along y.
        step: between neighbouring cells, in cells of the finest grid: 1, 2, 4 or 8.
    """

    keys: Tensor
    width: int
    height: int
    step: int = 1

    @staticmethod
    def of(cells: Tensor) -> tuple[Grid, Tensor]:
        """The grid of cells int64 [M, 3], x y z, M > 0; and the index of each in it, [M]."""
        # a corner at a cell of the coarsest grid: coarser cells then do not depend on its position
        corner = cells.amin(dim=0) // _COARSEST * _COARSEST - _COARSEST
        x, y, z = (cells - corner).unbind(dim=1)
        width, height = int(x.max()) + 1 + _COARSEST, int(y.max()) + 1 + _COARSEST
        keys, numbers = torch.unique(x + width * (y + height * z), return_inverse=True)
        return Grid(keys, width, height), numbers

    def to(self, device: Any) -> Grid:
        """This grid with its keys on a device."""
        return replace(self, keys=self.keys.to(device))

    def coarser(self) -> Grid:
        """The cells of twice the step that contain any of these."""
        step = 2 * self.step
        x = self.keys % self.width // step * step
        y = self.keys // self.width % self.height // step * step
        z = self.keys // (self.width * self.height) // step * step
        keys = torch.unique(x + self.width * (y + self.height * z))
        return Grid(keys, self.width, self.height, step)


@dataclass(frozen=True)
class Pairs:
    """Pairs of inputs and outputs, by the parts of a kernel.

    Parts are numbered as MinkowskiEngine does, x fastest: of size 3, part
    (dx + 1) + 3 (dy + 1) + 9 (dz + 1) takes the input that lies (dx, dy, dz) from the output.

    Attributes:
        parts: for each part int64 [P] and [P], numbers of the outputs and of their inputs.
        outputs: the number of outputs.
    """

    parts: tuple[tuple[Tensor, Tensor], ...]
    outputs: int


def pairs(outputs: Grid, inputs: Grid, size: int) -> Pairs:
    """The pairs of a convolution with a kernel of odd size.

    Between grids of one step, from a finer to a coarser one, or, transposed, to a finer one: then
    an input that lies (dx, dy, dz) from an output meets it by the part of (-dx, -dy, -dz).
    """
    parts = []
    for at, there in _neighbours(outputs, inputs, size):
        numbers = there.nonzero()[:, 0]
        parts.append((numbers, at.index_select(0, numbers)))
    if inputs.step > outputs.step:
        parts.reverse()
    return Pairs(tuple(parts), len(outputs.keys))


def _neighbours(outputs: Grid, inputs: Grid, size: int) -> Iterator[tuple[Tensor, Tensor]]:
    """For each part of a kernel the number of every output's input, and whether it is there."""
    step = min(outputs.step, inputs.step)
    reach = size // 2
    # after the last cell, so that every search ends at one
    keys = torch.cat([inputs.keys, inputs.keys.new_full((1,), _BEYOND)])
    for dz in range(-reach, reach + 1):
        for dy in range(-reach, reach + 1):
            wanted = outputs.keys + step * (outputs.width * (dy + outputs.height * dz) - reach)
            # cells of a row have consecutive keys: each is searched for once
            at = torch.searchsorted(keys, wanted)
            for _ in range(size):
                there = keys.index_select(0, at) == wanted
                yield at, there
                at = at + there
                wanted = wanted + step


def convolve(x: Tensor, kernel: Tensor, paired: Pairs) -> Tensor:
    """A sparse convolution.

    Args:
        x: float32 [N, C], a row for each cell of the input grid.
        kernel: [size³, C, D], parts in the order of ``Pairs``.
        paired: outputs and inputs.

    Returns:
        float32 [M, D], a row for each cell of the output grid.
    """
    y = x.new_zeros((paired.outputs, kernel.shape[2]))
    for weights, (outputs, inputs) in zip(kernel, paired.parts, strict=True):
        y.index_add_(0, outputs, (x.index_select(0, inputs) @ weights).to(y.dtype))
    return y


def convolve_occupancy(kernel: Tensor, grid: Grid) -> Tensor:
    """A convolution within a grid whose cells all contain 1.

    Args:
        kernel: [size³, 1, D]; for large sizes this is much faster.
        grid: N cells.

    Returns:
        float32 [N, D].
    """
    there = torch.stack([there for _, there in _neighbours(grid, grid, edge(kernel))])
    return (there.to(kernel.dtype).T @ kernel[:, 0]).to(kernel.dtype)


def edge(kernel: Tensor) -> int:
    """Cells along an edge of a kernel [size³, C, D]."""
    return round(math.pow(len(kernel), 1 / 3))
