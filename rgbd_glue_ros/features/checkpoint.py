"""Reads weights from a checkpoint, without running code that may be in it."""

from __future__ import annotations

import re
import warnings
from collections import OrderedDict
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.features.torch_library import torch
from rgbd_glue_ros.files.reading import open_file

_PARTS = ("state_dict", "extractor")
"""Names that authors use for the table of tensors in a checkpoint with further content."""


class _Table:
    """A plain table instead of a foreign type; torch fills no other kind of dictionary."""

    def __new__(cls) -> OrderedDict[str, Any]:  # type: ignore[misc]
        """Creates an empty table."""
        return OrderedDict()


class _Figure:
    """Accepts the arguments of a numpy number, and keeps nothing."""

    def __init__(self, *_: object) -> None: ...

    def __setstate__(self, _: object) -> None: ...


_SETTINGS = (
    ("easydict", "EasyDict", _Table),
    ("numpy", "dtype", _Figure),
    ("numpy.core.multiarray", "scalar", _Figure),
    ("numpy._core.multiarray", "scalar", _Figure),
)
"""Module and name of types next to weights in checkpoints, and their replacements."""


def read_tensors(path: Path, device: Any) -> dict[str, Any]:
    """The tensors of a checkpoint by name.

    Raises:
        InputError: the file is not a checkpoint, or contains something that could run code.
    """
    settings, load = _settings_aside(), torch.load
    with open_file(path) as file, settings, warnings.catch_warnings():
        # torch warns of an unusual file before it refuses it
        warnings.simplefilter("ignore")
        try:
            content = load(file, map_location=device, weights_only=True)
        # any other file is read as commands of a pickle, each of which may fail
        except Exception as error:
            raise _no_weights(path, error) from error
    tensors = content
    for part in _PARTS:
        tensors = tensors.get(part, tensors) if isinstance(tensors, dict) else tensors
    if not isinstance(tensors, dict) or not all(torch.is_tensor(t) for t in tensors.values()):
        raise InputError(path, "holds no table of weights", "give the published file")
    return {name: t.float() if t.is_floating_point() else t for name, t in tensors.items()}


def _no_weights(path: Path, error: Exception) -> InputError:
    reason = re.split(r"[.\n]", str(error))[0]
    said = f"{type(error).__name__}: {reason}" if reason else type(error).__name__
    return InputError(path, f"holds no weights ({said})", "remove it and fetch it again")


def _settings_aside() -> AbstractContextManager[Any]:
    """A context in which training state next to weights does not prevent reading them.

    Nothing is imported for it. An older torch, without this, rejects such a checkpoint.
    """
    if not hasattr(torch.serialization, "safe_globals"):
        return nullcontext()
    stand_ins = [
        type(name, (stand_in,), {"__module__": module}) for module, name, stand_in in _SETTINGS
    ]
    allowed: AbstractContextManager[Any] = torch.serialization.safe_globals(stand_ins)
    return allowed
