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
    """The device that ``features.device`` names; auto uses a GPU if there is one.

    Raises:
        InputError: cuda was requested and is not available.
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
    """A context without gradients; on a GPU products use half precision.

    On a CPU one thread computes. OpenMP threads wait for each other in a busy loop, and on busy
    cores, as on a robot, two were sixty times as slow as one.
    """
    if device.type == "cpu":
        # for the calling thread, so it is set every time
        torch.set_num_threads(1)
    half = torch.autocast("cuda", dtype=torch.float16, enabled=device.type == "cuda")
    with torch.inference_mode(), half:
        yield
