"""FCGF beside a dense network of the same weights, and its checkpoint as it was published."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from rigs.room import room_view

torch = pytest.importorskip("torch")
F = torch.nn.functional

from rigs.fcgf_weights import random_weights  # noqa: E402 - needs torch

from rgbd_glue_ros.errors import InputError  # noqa: E402
from rgbd_glue_ros.features.fcgf import FILE, Fcgf, describe  # noqa: E402
from rgbd_glue_ros.features.layers import Weights  # noqa: E402
from rgbd_glue_ros.features.sparse_convolution import Grid  # noqa: E402
from rgbd_glue_ros.parameters import FeaturesConfig  # noqa: E402

torch.set_num_threads(1)

BOX = 16


def bumpy_cells() -> Any:
    """Cells [N, 3] of a surface that rises and falls, in a box."""
    x, y = np.meshgrid(np.arange(BOX), np.arange(BOX), indexing="ij")
    z = np.round(6 + 4 * np.sin(x / 3) * np.cos(y / 4)).astype(np.int64)
    floor = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    return torch.from_numpy(np.unique(np.concatenate([floor, floor + np.array([0, 0, 1])]), axis=0))


class DenseNetwork:
    """ResUNetBN2C written as torch writes U-nets: on whole volumes, 0 where nothing is."""

    def __init__(self, tensors: dict[str, Any], occupied: Any) -> None:
        self._tensors = tensors
        self._masks = [occupied]
        for _ in range(3):
            self._masks.append(F.max_pool3d(self._masks[-1], 2))

    def __call__(self) -> Any:
        first = self._tensors["conv1.kernel"].shape[0]
        x = self._normalised(self._convolution(self._masks[0], "conv1", round(first ** (1 / 3))), 1)
        x = self._block(x * self._masks[0], "block1", 0)
        finer = []
        for level in (1, 2, 3):
            finer.append(x)
            x = self._convolution(x, f"conv{level + 1}", 3, stride=2)
            x = self._normalised(x, level + 1) * self._masks[level]
            x = self._block(x, f"block{level + 1}", level)
        for level in (2, 1, 0):
            x = F.conv_transpose3d(
                x, self._kernel(f"conv{level + 2}_tr", 3).transpose(0, 1), None, 2, 1, 1
            )
            x = self._normalised(x, f"{level + 2}_tr") * self._masks[level]
            x = torch.cat([self._block(x, f"block{level + 2}_tr", level), finer.pop()], dim=1)
        x = torch.einsum("bcxyz,cd->bdxyz", x, self._tensors["conv1_tr.kernel"]).relu()
        x = torch.einsum("bcxyz,cd->bdxyz", x, self._tensors["final.kernel"])
        x = x + self._tensors["final.bias"][0, :, None, None, None]
        return x / x.norm(dim=1, keepdim=True)

    def _kernel(self, name: str, size: int) -> Any:
        kernel = self._tensors[f"{name}.kernel"]
        return kernel.reshape(size, size, size, *kernel.shape[1:]).permute(4, 3, 2, 1, 0)

    def _convolution(self, x: Any, name: str, size: int, stride: int = 1) -> Any:
        return F.conv3d(x, self._kernel(name, size), stride=stride, padding=size // 2)

    def _normalised(self, x: Any, number: int | str, block: str = "") -> Any:
        mean, variance, scale, shift = (
            self._tensors[f"{block}norm{number}.bn.{part}"][:, None, None, None]
            for part in ("running_mean", "running_var", "weight", "bias")
        )
        return (x - mean) / (variance + 1e-5).sqrt() * scale + shift

    def _block(self, x: Any, name: str, level: int) -> Any:
        mask = self._masks[level]
        y = self._normalised(self._convolution(x, f"{name}.conv1", 3), 1, f"{name}.")
        y = self._convolution(y.relu() * mask, f"{name}.conv2", 3)
        return (self._normalised(y, 2, f"{name}.") + x).relu() * mask


@pytest.mark.parametrize("first_size", [5, 7])
def test_the_network_is_the_dense_one_where_there_are_voxels(first_size: int) -> None:
    tensors = random_weights(first_size=first_size)
    cells = bumpy_cells()
    occupied = torch.zeros((1, 1, BOX, BOX, BOX))
    x, y, z = cells.T
    occupied[0, 0, x, y, z] = 1
    expected = DenseNetwork(tensors, occupied)()[0, :, x, y, z].T
    grid, numbers = Grid.of(cells)
    found = describe(grid, Weights(tensors))[numbers]
    assert (found.std(dim=0) > 0.01).all()
    torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-4)


def test_descriptors_have_length_1() -> None:
    found = describe(Grid.of(bumpy_cells())[0], Weights(random_weights()))
    torch.testing.assert_close(found.norm(dim=1), torch.ones(len(found)), rtol=0, atol=1e-5)


@pytest.mark.parametrize("shift", [(8, 0, 0), (-16, 8, 64)])
def test_a_shift_by_coarsest_voxels_changes_no_bit(shift: tuple[int, int, int]) -> None:
    w, cells = Weights(random_weights()), bumpy_cells()
    here, there = (describe(Grid.of(c)[0], w) for c in (cells, cells + torch.tensor(shift)))
    torch.testing.assert_close(here, there, rtol=0, atol=0)


# the checkpoint


@pytest.fixture
def checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file as FCGF's training writes it: old format, an optimiser's state, an EasyDict."""
    module = ModuleType("easydict")
    settings = type("EasyDict", (dict,), {"__module__": "easydict"})
    module.EasyDict = settings  # type: ignore[attr-defined]
    content = {
        "epoch": 100,
        "state_dict": {
            **random_weights(),
            "norm1.bn.num_batches_tracked": torch.tensor(7),
        },
        "optimizer": {"state": {0: {"momentum_buffer": torch.ones(3)}}, "param_groups": []},
        "scheduler": {"base_lrs": [0.1]},
        "config": settings(conv1_kernel_size=7, model="ResUNetBN2C"),
        "best_val": np.float64(0.9),
        "best_val_metric": "feat_match_ratio",
    }
    path = tmp_path / FILE
    with monkeypatch.context() as while_written:
        while_written.setitem(sys.modules, "easydict", module)
        torch.save(content, path, _use_new_zipfile_serialization=False)
    return path


def fcgf(folder: Path) -> Fcgf:
    return Fcgf(FeaturesConfig(weights=str(folder), device="cpu", voxel=0.05))


@pytest.mark.slow
def test_a_checkpoint_is_read_as_it_was_published(checkpoint: Path) -> None:
    seen = fcgf(checkpoint.parent).extract(room_view(0.0))
    assert seen.descriptors.shape == (len(seen.points), 32)
    assert seen.descriptors.dtype == np.float32
    # a point a voxel, and within it
    voxels = np.floor(seen.points / 0.05).astype(np.int64)
    assert len(np.unique(voxels, axis=0)) == len(voxels)
    # settings are not made of the class that the file names
    assert "easydict" not in sys.modules


def test_a_checkpoint_that_is_cut_short_is_told_in_one_line(checkpoint: Path) -> None:
    checkpoint.write_bytes(checkpoint.read_bytes()[:-1000])
    with pytest.raises(InputError, match="holds no weights") as told:
        fcgf(checkpoint.parent)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"conv2.kernel": (27, 32, 32)}, r"conv2\.kernel is of shape \[27, 32, 32\]"),
        ({"final.kernel": (64, 16)}, r"final\.kernel is of shape \[64, 16\]"),
        ({"conv1.kernel": None}, r"conv1\.kernel is missing"),
    ],
)
def test_another_architecture_is_told_in_one_line(
    change: dict[str, tuple[int, ...] | None], says: str, tmp_path: Path
) -> None:
    tensors = random_weights()
    for name, shape in change.items():
        del tensors[name]
        if shape is not None:
            tensors[name] = torch.zeros(shape)
    torch.save({"state_dict": tensors}, tmp_path / FILE)
    with pytest.raises(InputError, match=f"is not FCGF's ResUNetBN2C .{says}") as told:
        fcgf(tmp_path)
    assert "\n" not in str(told.value)


def test_a_checkpoint_that_is_missing_names_where_its_authors_give_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"are missing; get them from github.com/chrischoy/FCGF"):
        fcgf(tmp_path)
