"""Keypoints from the map of scores that a network computes for every pixel."""

from __future__ import annotations

from rgbd_glue_ros.features.layers import Tensor
from rgbd_glue_ros.features.torch_library import F, torch

_TEMPERATURE = 0.1
"""Softness of the maximum that places a keypoint between pixels: ALIKE's and ALIKED's."""


def local_maxima(scores: Tensor, radius: int) -> Tensor:
    """Mask [H, W] of local maxima of the scores, with repeated suppression.

    Twice more, maxima are searched for away from those found so far.
    """
    maxima = scores == greatest_around(scores, radius)
    for _ in range(2):
        near = greatest_around(maxima.float(), radius) > 0
        rest = torch.where(near, 0.0, scores)
        maxima = maxima | ((rest == greatest_around(rest, radius)) & ~near)
    return maxima


def greatest_around(scores: Tensor, radius: int) -> Tensor:
    """The highest score within a radius to each side, [H, W]."""
    return F.max_pool2d(scores[None, None], 2 * radius + 1, stride=1, padding=radius)[0, 0]


def strongest(
    scores: Tensor, peaks: Tensor, most: int, before: int = 0, behind: int = 0
) -> tuple[Tensor, Tensor]:
    """Rows and columns [N] of the peaks with the highest scores.

    Args:
        scores: [H, W].
        peaks: mask [H, W].
        most: maximum number of peaks.
        before: rows at the top and columns at the left without peaks.
        behind: rows at the bottom and columns at the right without peaks.
    """
    height, width = scores.shape
    inside = torch.zeros_like(peaks)
    inside[before : height - behind, before : width - behind] = True
    rows, columns = torch.nonzero(peaks & inside, as_tuple=True)
    order = torch.argsort(scores[rows, columns], descending=True, stable=True)[:most]
    return rows[order], columns[order]


def soft_offsets(scores: Tensor, rows: Tensor, columns: Tensor, radius: int) -> Tensor:
    """Position of the scores' soft maximum in the window around each peak, [N, 2] in x and y."""
    steps = torch.arange(-radius, radius + 1, device=scores.device)
    dy, dx = (grid.reshape(-1) for grid in torch.meshgrid(steps, steps, indexing="ij"))
    window = scores[rows[:, None] + dy, columns[:, None] + dx]
    part = torch.softmax(window / _TEMPERATURE, dim=1)
    # not a matrix product, which would use half precision on a GPU
    return (part[:, :, None] * torch.stack([dx, dy], dim=1)).sum(dim=1)


def sample(maps: Tensor, uv: Tensor) -> Tensor:
    """Maps [D, H, W] between pixels, [N, D]."""
    height, width = maps.shape[1:]
    size = torch.tensor([width - 1, height - 1], device=uv.device)
    grid = (uv / size * 2 - 1)[None, None]
    return F.grid_sample(maps[None], grid, mode="bilinear", align_corners=True)[0, :, 0].T
