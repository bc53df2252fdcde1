"""Sparse convolutions are dense ones at the cells that hold something."""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest

torch = pytest.importorskip("torch")
F = torch.nn.functional

from rgbd_glue_ros.features.sparse_convolution import (  # noqa: E402 - needs torch
    Grid,
    convolve,
    convolve_occupancy,
    pairs,
)

torch.set_num_threads(1)

BOX = (16, 24, 8)
"""Cells along x, y and z: not alike, so that no two axes can be taken for each other."""
CORNER = (-16, 8, 0)


def half_full(seed: int = 0) -> Any:
    """Cells int64 [N, 3] of half of a box, in no order."""
    random = torch.Generator().manual_seed(seed)
    everything = torch.cartesian_prod(*(torch.arange(edge) for edge in BOX))
    chosen = torch.randperm(len(everything), generator=random)[: len(everything) // 2]
    return everything[chosen] + torch.tensor(CORNER)


def grids(cells: Any) -> list[Grid]:
    """The grid of steps 1, 2, 4 and 8."""
    found = [Grid.of(cells)[0]]
    for _ in range(3):
        found.append(found[-1].coarser())
    return found


def cells_of(grid: Grid, cells: Any) -> Any:
    """Places in the box of the cells of a grid, in its order and step."""
    coarse = cells // grid.step * grid.step
    _, numbers = Grid.of(coarse)
    places = torch.empty((len(grid.keys), 3), dtype=torch.int64)
    places[numbers] = (coarse - torch.tensor(CORNER)) // grid.step
    return places


def dense(x: Any, grid: Grid, cells: Any) -> Any:
    """Rows [N, C] as a volume [1, C, X, Y, Z], 0 where nothing is."""
    volume = torch.zeros((x.shape[1], *(edge // grid.step for edge in BOX)))
    rows, columns, layers = cells_of(grid, cells).T
    volume[:, rows, columns, layers] = x.T
    return volume[None]


def at_cells(volume: Any, grid: Grid, cells: Any) -> Any:
    """Rows [N, C] of a volume [1, C, X, Y, Z]."""
    rows, columns, layers = cells_of(grid, cells).T
    return volume[0, :, rows, columns, layers].T


def dense_kernel(kernel: Any, size: int) -> Any:
    """[D, C, x, y, z], as conv3d has it, of parts in which x runs fastest."""
    return kernel.reshape(size, size, size, *kernel.shape[1:]).permute(4, 3, 2, 1, 0)


def random(*shape: int) -> Any:
    return torch.randn(shape, generator=torch.Generator().manual_seed(1))


@pytest.mark.parametrize("level", [0, 1, 2, 3])
@pytest.mark.parametrize("size", [1, 3, 5])
def test_a_convolution_within_a_grid_is_the_dense_one(level: int, size: int) -> None:
    cells = half_full()
    grid = grids(cells)[level]
    x, kernel = random(len(grid.keys), 5), random(size**3, 5, 7)
    expected = F.conv3d(dense(x, grid, cells), dense_kernel(kernel, size), padding=size // 2)
    found = convolve(x, kernel, pairs(grid, grid, size))
    torch.testing.assert_close(found, at_cells(expected, grid, cells), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_convolution_to_a_coarser_grid_is_the_dense_one(level: int) -> None:
    cells = half_full()
    fine, coarse = grids(cells)[level : level + 2]
    x, kernel = random(len(fine.keys), 5), random(27, 5, 7)
    expected = F.conv3d(dense(x, fine, cells), dense_kernel(kernel, 3), stride=2, padding=1)
    found = convolve(x, kernel, pairs(coarse, fine, 3))
    torch.testing.assert_close(found, at_cells(expected, coarse, cells), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_transposed_convolution_to_a_finer_grid_is_the_dense_one(level: int) -> None:
    cells = half_full()
    fine, coarse = grids(cells)[level : level + 2]
    x, kernel = random(len(coarse.keys), 5), random(27, 5, 7)
    expected = F.conv_transpose3d(
        dense(x, coarse, cells),
        dense_kernel(kernel, 3).transpose(0, 1),
        stride=2,
        padding=1,
        output_padding=1,
    )
    found = convolve(x, kernel, pairs(fine, coarse, 3))
    torch.testing.assert_close(found, at_cells(expected, fine, cells), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("size", [3, 7])
def test_convolving_occupancy_equals_convolving_ones(size: int) -> None:
    grid, _ = Grid.of(half_full())
    kernel = random(size**3, 1, 6)
    expected = convolve(torch.ones(len(grid.keys), 1), kernel, pairs(grid, grid, size))
    torch.testing.assert_close(convolve_occupancy(kernel, grid), expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("size", [3, 7])
def test_the_parts_of_a_kernel_are_numbered_as_minkowski_engine_does(size: int) -> None:
    # FCGF's authors give it where they convert their checkpoints to another library: of offsets
    # from the least one, ax + ay * size + az * size², and an output takes the input at its offset
    reach = size // 2
    kernel = torch.arange(size**3, dtype=torch.float32)[:, None, None]
    middle = size**3 // 2
    for ax, ay, az in product((0, reach, reach + 1, size - 1), repeat=3):
        offset = torch.tensor([[ax - reach, ay - reach, az - reach]])
        cells = torch.cat([torch.zeros((1, 3), dtype=torch.int64), offset])
        grid, numbers = Grid.of(cells)
        if len(grid.keys) == 1:
            continue
        found = convolve(torch.ones(2, 1), kernel, pairs(grid, grid, size))[numbers]
        part = ax + ay * size + az * size**2
        assert found[0].item() == middle + part
        assert found[1].item() == middle + size**3 - 1 - part


def test_a_coarser_cell_is_there_where_a_finer_one_is() -> None:
    cells = half_full()
    for grid in grids(cells)[1:]:
        expected = {tuple(cell) for cell in (cells // grid.step).tolist()}
        assert len(grid.keys) == len(expected)


@pytest.mark.parametrize("shift", [(1, 0, 0), (0, -3, 0), (5, 7, -11), (800, -800, 3)])
def test_a_convolution_does_not_depend_on_where_the_cells_are(shift: tuple[int, int, int]) -> None:
    cells = half_full()
    kernel = random(27, 1, 4)
    here, there = (Grid.of(moved)[0] for moved in (cells, cells + torch.tensor(shift)))
    x = random(len(here.keys), 1)
    torch.testing.assert_close(
        convolve(x, kernel, pairs(here, here, 3)),
        convolve(x, kernel, pairs(there, there, 3)),
        rtol=0,
        atol=0,
    )


def test_a_cell_at_the_border_has_no_neighbour_on_the_other_side() -> None:
    row = torch.tensor([[x, y, 0] for x in (0, 40) for y in (0, 1)])
    grid, _ = Grid.of(row)
    # each sees itself and the one beside it, though rows of the grid follow each other in memory
    found = convolve(torch.ones(4, 1), torch.ones(343, 1, 1), pairs(grid, grid, 7))
    assert found[:, 0].tolist() == [2, 2, 2, 2]
