"""Map files: keyframes with their images, and the measurements between them.

Features are not stored: they are extracted again, with the parameters in use.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import open_file
from rgbd_glue_ros.files.writing import write_whole
from rgbd_glue_ros.geometry.depth_noise import depth_noise_of
from rgbd_glue_ros.messages.image_codecs import decode, encode_png
from rgbd_glue_ros.slam.map_check import check_edges, covariances, numbers, transforms
from rgbd_glue_ros.slam.packed_view import PackedView, packed
from rgbd_glue_ros.types import (
    CameraIntrinsics,
    EdgeOrigin,
    Float32,
    Float64,
    PoseGraph,
    PoseGraphEdge,
    Trajectory,
    UInt8,
    View,
)

_FORMAT_NAME = "rgbd_glue_ros map "
_FORMAT = f"{_FORMAT_NAME}1"
# Earlier maps have the description of an origin in place of its name.
_NAMES_OF_ORIGINS = {
    "the child was tracked from the parent": "tracking",
    "the camera was lost in between, and hardly moved as far as the covariance says": "assumed",
    "the child saw again what the parent, an anchor of long ago, had seen": "revisit",
    "recognised by appearance and verified by registration": "loop",
    **{origin.value: origin.name for origin in EdgeOrigin},
}
# Unit of depth in a file: an eighth of the noise at the nearest, and 16 m in 16 bits.
_DEPTH_UNIT_M = 0.00025
_FARTHEST = 65535
# Maximum number of keyframes in a file: at 0.3 MB each, 30 GB.
_MOST_KEYFRAMES = 100_000


_Result = TypeVar("_Result")
OnKeyframe = Callable[[int, int], None]
"""Called with the number of keyframes that are done, and that of all."""


@dataclass(frozen=True)
class SavedMap:
    """A map as stored in a file.

    Attributes:
        graph: T_map_camera of the keyframes, and the edges between them.
        views: images of each keyframe, compressed.
        name: what to call it in a message: its file.
    """

    graph: PoseGraph
    views: tuple[PackedView, ...]
    name: str = "the map"

    def __len__(self) -> int:
        return len(self.views)


def write_map(path: Path, saved: SavedMap, backup: Path | None = None) -> None:
    """Writes a map atomically.

    Args:
        path: its file.
        saved: the map.
        backup: as for ``write_whole``.

    Raises:
        InputError: the file cannot be written, or a keyframe cannot be stored.
    """
    edges, views = saved.graph.edges, [packed_view.rest for packed_view in saved.views]
    arrays: dict[str, Any] = {
        "format": np.array(_FORMAT),
        "stamps_ns": saved.graph.keyframes.stamps_ns,
        "poses": saved.graph.keyframes.poses,
        "edge_ends": np.array([(e.parent, e.child) for e in edges], np.int64).reshape(-1, 2),
        "edge_poses": np.array([e.T_parent_child for e in edges]).reshape(-1, 4, 4),
        "edge_covariances": np.array([e.covariance for e in edges]).reshape(-1, 6, 6),
        "edge_origins": np.array([e.origin.name.lower() for e in edges], np.str_),
        "cameras": np.array([v.intrinsics.focal_and_centre for v in views]).reshape(-1, 4),
        "twists": np.array([v.twist for v in views]).reshape(-1, 6),
        "times": np.array([(v.readout_time, v.depth_delay) for v in views]).reshape(-1, 2),
        "contrasts": np.array([v.contrast for v in views]),
    }
    for i, view in enumerate(saved.views):
        arrays[f"grey_{i}"] = np.frombuffer(view.grey, np.uint8)
        units = _in_units(view.depth.unpacked())
        arrays[f"depth_{i}"] = np.frombuffer(encode_png(units), np.uint8)
    file = BytesIO()
    np.savez(file, **arrays)
    write_whole(path, file.getvalue(), backup)


def read_map(path: Path, on_keyframe: OnKeyframe = lambda _done, _total: None) -> SavedMap:
    """Reads a map.

    Args:
        path: its file.
        on_keyframe: called after each keyframe.

    Raises:
        InputError: the file cannot be read, is not a map, or is of another version.
    """
    return _read(path, lambda arrays: _map(arrays, path, on_keyframe))


def keyframes_in(path: Path) -> int:
    """The number of keyframes in the file of a map, which are not read.

    Raises:
        InputError: the file cannot be read, or is not a map.
    """
    return _read(path, lambda arrays: len(arrays["stamps_ns"]))


def _read(path: Path, read: Callable[[Mapping[str, Any]], _Result]) -> _Result:
    """What a function makes of the arrays of a map's file, which may be any file."""
    with open_file(path) as file:
        if not file.read(1):
            raise InputError(path, "is empty", "give one of --save-map")
        try:
            _check_stored(zipfile.ZipFile(file))
            file.seek(0)
            with np.load(file, allow_pickle=False) as arrays:
                _check_format(str(arrays["format"]), path)
                return read(arrays)
        except InputError:
            raise
        except Exception as error:
            raise InputError(
                path, f"holds no valid map ({_why(error)})", "give one of --save-map"
            ) from error


def _why(error: Exception) -> str:
    """What is wrong in one line; some errors have no text, and those of a key have quotes."""
    if isinstance(error, zipfile.BadZipFile):
        return "it is cut off or damaged, or of another kind"
    text = error.args[0] if isinstance(error, KeyError) and error.args else str(error)
    return str(text) or type(error).__name__


def _check_stored(archive: zipfile.ZipFile) -> None:
    """Refuses entries that would expand on reading: images are already compressed."""
    if any(entry.compress_type != zipfile.ZIP_STORED for entry in archive.infolist()):
        raise ValueError("an entry is compressed")


def _map(arrays: Mapping[str, Any], path: Path, on_keyframe: OnKeyframe) -> SavedMap:
    stamps = arrays["stamps_ns"]
    if stamps.dtype != np.int64 or stamps.ndim != 1 or not 0 < len(stamps) <= _MOST_KEYFRAMES:
        raise ValueError(f"stamps_ns are {stamps.dtype} {list(stamps.shape)}")
    count = len(stamps)
    poses = transforms(arrays, "poses", count)
    edges = _edges(arrays)
    check_edges(edges, count)
    cameras, twists = numbers(arrays, "cameras", (count, 4)), numbers(arrays, "twists", (count, 6))
    times, contrasts = numbers(arrays, "times", (count, 2)), _contrasts(arrays, count)
    views = []
    for i in range(count):
        grey, depth = _images(arrays, i, path)
        camera = _camera(cameras[i], grey.shape, i)
        readout_time, depth_delay = times[i].tolist()
        contrast = float(contrasts[i])
        noise = depth_noise_of(depth)
        view = View(grey, depth, camera, twists[i], readout_time, depth_delay, contrast, noise)
        views.append(packed(view))
        on_keyframe(i + 1, count)
    return SavedMap(PoseGraph(Trajectory(stamps, poses), edges), tuple(views), str(path))


def _check_format(found: str, path: Path) -> None:
    if found == _FORMAT:
        return
    if found.startswith(_FORMAT_NAME):
        cause = f"is a map of another version of this package ({found}; this one reads {_FORMAT})"
        raise InputError(path, cause, "make the map anew, or use that version")
    raise ValueError(f"the format is {found}")


def _edges(arrays: Mapping[str, Any]) -> tuple[PoseGraphEdge, ...]:
    ends, origins = arrays["edge_ends"], arrays["edge_origins"]
    count = len(origins)
    if ends.shape != (count, 2) or ends.dtype.kind not in "iu":
        raise ValueError(f"edge_ends are {ends.dtype} {list(ends.shape)}")
    poses = transforms(arrays, "edge_poses", count)
    errors = covariances(arrays, "edge_covariances", count)
    return tuple(
        PoseGraphEdge(parent, child, T, covariance, _origin(str(origin)))
        for (parent, child), T, covariance, origin in zip(
            ends.tolist(), poses, errors, origins, strict=True
        )
    )


def _origin(text: str) -> EdgeOrigin:
    name = _NAMES_OF_ORIGINS.get(text, text).upper()
    if name not in EdgeOrigin.__members__:
        raise ValueError(f"unknown origin {text} of an edge")
    return EdgeOrigin[name]


def _images(arrays: Mapping[str, Any], i: int, path: Path) -> tuple[UInt8, Float32]:
    grey, units = (
        decode(arrays[f"{name}_{i}"].tobytes(), f"{path}: {name} of keyframe {i}")
        for name in ("grey", "depth")
    )
    if grey.dtype != np.uint8 or units.dtype != np.uint16 or grey.shape != units.shape:
        raise ValueError(f"images of keyframe {i} that do not match")
    depth = np.where(units > 0, units * np.float32(_DEPTH_UNIT_M), np.float32(np.nan))
    return np.asarray(grey, np.uint8), np.asarray(depth, np.float32)


def _camera(pinhole: Float64, shape: tuple[int, ...], i: int) -> CameraIntrinsics:
    height, width = shape
    try:
        return CameraIntrinsics(width, height, *pinhole.tolist())
    except InputError as error:
        raise ValueError(f"the camera of keyframe {i}: {error.where} {error.cause}") from error


def _contrasts(arrays: Mapping[str, Any], count: int) -> Float64:
    # maps of earlier versions do not have it
    contrasts = numbers(arrays, "contrasts", (count,)) if "contrasts" in arrays else np.ones(count)
    wrong = np.flatnonzero((contrasts <= 0) | (contrasts > 1))
    if len(wrong):
        raise ValueError(f"contrast {contrasts[wrong[0]]:g} of keyframe {wrong[0]}")
    return contrasts


def _in_units(depth: Float32) -> np.typing.NDArray[np.uint16]:
    units = np.rint(np.nan_to_num(depth) / _DEPTH_UNIT_M)
    return np.where((units > 0) & (units <= _FARTHEST), units, 0).astype(np.uint16)
