"""PyTorch, imported when a learned feature first computes: it takes seconds and is optional."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rgbd_glue_ros.errors import InputError, MissingExtraError


class _Deferred:
    """A module that is imported at the first use of something in it."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        try:
            module = importlib.import_module(self._name)
        except ImportError as error:
            raise MissingExtraError("torch", "learned", "a learned feature") from error
        return getattr(module, attribute)


torch: Any = _Deferred("torch")
F: Any = _Deferred("torch.nn.functional")


def device_of(name: str) -> Any:
    """The device that ``features.device`` names; auto takes a GPU where there is one.

    Raises:
        InputError: cuda was asked for and there is none.
        MissingExtraError: torch is not installed.
    """
    there = torch.cuda.is_available()
    if name == "cuda" and not there:
        raise InputError(
            "features.device: cuda",
            "torch finds no GPU",
            "give auto or cpu, or install torch for your CUDA version",
        )
    return torch.device("cuda" if there and name != "cpu" else "cpu")


@contextmanager
def inference(device: Any) -> Iterator[None]:
    """Nothing is kept for gradients; on a GPU products are taken in half precision.

    On a CPU one thread computes. Threads of OpenMP wait for each other in a busy loop, and where
    other work takes the cores, as that of a robot does, two were sixty times as slow as one.
    """
    if device.type == "cpu":
        # of the calling thread, so it is said every time
        torch.set_num_threads(1)
    half = torch.autocast("cuda", dtype=torch.float16, enabled=device.type == "cuda")
    with torch.inference_mode(), half:
        yield
