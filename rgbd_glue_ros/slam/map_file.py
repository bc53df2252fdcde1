"""Map files: keyframes with their images, and the measurements between them.

Features are not stored: they are extracted again, with the parameters in use.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.pose_graph import PoseGraph
from rgbd_glue_ros.files.reading import open_file
from rgbd_glue_ros.files.writing import write_whole
from rgbd_glue_ros.messages.image_codecs import decode, encode_png
from rgbd_glue_ros.types import (
    CameraIntrinsics,
    EdgeOrigin,
    Float32,
    PoseGraphEdge,
    Trajectory,
    View,
)

ENDING = ".rgbdmap"

_FORMAT = "rgbd_glue_ros map 1"
# Unit of depth in a file: an eighth of the noise at the nearest, and 16 m in 16 bits.
_DEPTH_UNIT_M = 0.00025
_FARTHEST = 65535
# Maximum number of keyframes in a file: at 0.3 MB each, 30 GB.
_MOST_KEYFRAMES = 100_000


@dataclass(frozen=True)
class SavedMap:
    """A map as stored in a file.

    Attributes:
        graph: T_map_camera of the keyframes, and the edges between them.
        views: images of each keyframe.
    """

    graph: PoseGraph
    views: tuple[View, ...]

    def __len__(self) -> int:
        return len(self.views)


def write_map(path: Path, saved: SavedMap) -> None:
    """Writes a map atomically.

    Raises:
        InputError: the file cannot be written, or a keyframe cannot be stored.
    """
    edges, views = saved.graph.edges, saved.views
    arrays: dict[str, Any] = {
        "format": np.array(_FORMAT),
        "stamps_ns": saved.graph.keyframes.stamps_ns,
        "poses": saved.graph.keyframes.poses,
        "edge_ends": np.array([(e.parent, e.child) for e in edges], np.int64).reshape(-1, 2),
        "edge_poses": np.array([e.T_parent_child for e in edges]).reshape(-1, 4, 4),
        "edge_covariances": np.array([e.covariance for e in edges]).reshape(-1, 6, 6),
        "edge_origins": np.array([e.origin.value for e in edges], np.str_),
        "cameras": np.array([v.intrinsics.focal_and_centre for v in views]).reshape(-1, 4),
        "twists": np.array([v.twist for v in views]).reshape(-1, 6),
        "times": np.array([(v.readout_time, v.depth_delay) for v in views]).reshape(-1, 2),
        "contrasts": np.array([v.contrast for v in views]),
    }
    for i, view in enumerate(views):
        arrays[f"grey_{i}"] = np.frombuffer(encode_png(view.grey), np.uint8)
        arrays[f"depth_{i}"] = np.frombuffer(encode_png(_in_units(view.depth)), np.uint8)
    file = BytesIO()
    np.savez(file, **arrays)
    write_whole(path, file.getvalue())


def read_map(path: Path) -> SavedMap:
    """Reads a map.

    Raises:
        InputError: the file cannot be read, or is not a map.
    """
    with open_file(path) as file:
        try:
            _check_stored(zipfile.ZipFile(file))
            file.seek(0)
            with np.load(file, allow_pickle=False) as arrays:
                return _map(arrays, path)
        except InputError:
            raise
        except Exception as error:
            raise InputError(
                path, f"holds no valid map ({error})", "give one of --save-map"
            ) from error


def _check_stored(archive: zipfile.ZipFile) -> None:
    """Refuses entries that would expand on reading: images are already compressed."""
    if any(entry.compress_type != zipfile.ZIP_STORED for entry in archive.infolist()):
        raise ValueError("an entry is compressed")


def _map(arrays: Mapping[str, Any], path: Path) -> SavedMap:
    if str(arrays["format"]) != _FORMAT:
        raise ValueError(f"the format is {arrays['format']}")
    stamps, poses = arrays["stamps_ns"], arrays["poses"]
    count = len(stamps)
    if not 0 < count <= _MOST_KEYFRAMES:
        raise ValueError(f"{count} keyframes")
    if stamps.dtype != np.int64 or poses.shape != (count, 4, 4) or not np.isfinite(poses).all():
        raise ValueError("invalid poses")
    ends = arrays["edge_ends"]
    if ends.size and not (ends.min() >= 0 and ends.max() < count):
        raise ValueError("an edge of a missing keyframe")
    edges = tuple(
        PoseGraphEdge(int(parent), int(child), T, covariance, EdgeOrigin(str(origin)))
        for (parent, child), T, covariance, origin in zip(
            ends,
            arrays["edge_poses"],
            arrays["edge_covariances"],
            arrays["edge_origins"],
            strict=True,
        )
    )
    views = tuple(_view(arrays, i, path) for i in range(count))
    return SavedMap(PoseGraph(Trajectory(stamps, poses), edges), views)


def _view(arrays: Mapping[str, Any], i: int, path: Path) -> View:
    grey, units = (
        decode(arrays[f"{name}_{i}"].tobytes(), f"{path}: {name} of keyframe {i}")
        for name in ("grey", "depth")
    )
    if grey.dtype != np.uint8 or units.dtype != np.uint16 or grey.shape != units.shape:
        raise ValueError(f"images of keyframe {i} that do not match")
    depth = np.where(units > 0, units * np.float32(_DEPTH_UNIT_M), np.float32(np.nan))
    fx, fy, cx, cy = map(float, arrays["cameras"][i])
    height, width = grey.shape
    readout_time, depth_delay = map(float, arrays["times"][i])
    return View(
        grey,
        np.asarray(depth, np.float32),
        CameraIntrinsics(width, height, fx, fy, cx, cy),
        arrays["twists"][i],
        readout_time,
        depth_delay,
        _contrast(arrays, i),
    )


def _contrast(arrays: Mapping[str, Any], i: int) -> float:
    # maps of earlier versions do not have it
    contrast = float(arrays["contrasts"][i]) if "contrasts" in arrays else 1.0
    if not 0 < contrast <= 1:
        raise ValueError(f"contrast {contrast:g} of keyframe {i}")
    return contrast


def _in_units(depth: Float32) -> np.typing.NDArray[np.uint16]:
    units = np.rint(np.nan_to_num(depth) / _DEPTH_UNIT_M)
    return np.where((units > 0) & (units <= _FARTHEST), units, 0).astype(np.uint16)
