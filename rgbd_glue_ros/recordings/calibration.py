"""Camera calibration files of many programs.

Supported are those of ROS (``camera_calibration``, and a CameraInfo as ``ros2 topic echo`` prints
it), OpenCV, ORB-SLAM2 and 3, Kalibr, Open3D, COLMAP, BundleFusion, NICE-SLAM, Record3D, nerfstudio
and the RealSense SDK, and bare numbers: a matrix [3, 3] or [4, 4], or fx fy cx cy. They contain the
same information under different names, so a file is read as a tree of names and values, with a
table of known names.
"""

from __future__ import annotations

import json
import logging
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.bounded_yaml import BoundedLoader, documents
from rgbd_glue_ros.files.reading import read_text
from rgbd_glue_ros.messages.camera_info import intrinsics_from_message
from rgbd_glue_ros.messages.fields import CameraInfo
from rgbd_glue_ros.messages.making import header
from rgbd_glue_ros.parameters import metres_per_unit
from rgbd_glue_ros.recordings.calibration_texts import (
    bundle_fusion_cameras,
    colmap_cameras,
    ost_camera,
)
from rgbd_glue_ros.types import CameraIntrinsics, Float64

logger = logging.getLogger(__name__)

_MATRIX = (
    "camera_matrix",
    "cameramatrix",
    "intrinsic_matrix",
    "k",
    "mtx",
    "intrinsics",
    "intrinsic",
)
_COEFFICIENTS = (
    "distortion_coefficients",
    "distortion_coeffs",
    "distcoeffs",
    "dist_coeffs",
    "distortion",
    "dist",
    "coeffs",
    "d",
)
_MODEL = ("distortion_model", "model", "type", "camera_type", "camera_model")
_KIND = ("camera_model", "model_type")
_WIDTH, _HEIGHT = ("image_width", "width", "w"), ("image_height", "height", "h")
_SIZE = ("resolution", "image_size", "image_resolution")
_FOCAL_AND_CENTRE = (("fx", "fl_x"), ("fy", "fl_y"), ("cx", "ppx"), ("cy", "ppy"))
_DEPTH_SCALE = ("depthmapfactor", "png_depth_scale", "depth_scale", "scale")
# By name, if they are not in a list
_PLUMB_BOB = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_EQUIDISTANT = ("k1", "k2", "k3", "k4")
# Names of cameras in a file of several
_OF_COLOR, OF_DEPTH = (re.compile(name, re.IGNORECASE) for name in (r"colou?r|rgb", "depth"))
# Focal lengths along rows and columns differ by less than this fraction, the principal point by
# more
_NEARLY_ONE = 0.05
# Lenses that no supported model approximates
_UNKNOWN_CAMERAS = {"omni", "ds", "eucm", "mei", "scaramuzza"}

_REMEDY = (
    "give width, height, and fx, fy, cx, cy or a camera_matrix, in YAML or JSON, or a bare 3x3 "
    "matrix as text"
)


@dataclass(frozen=True)
class Calibration:
    """The content of a calibration file.

    Attributes:
        intrinsics: the camera; width and height are 0 if the file does not give them.
        depth_scale: metres per unit of the depth images; None if the file does not give it.
        source: the file, for errors.
    """

    intrinsics: CameraIntrinsics
    depth_scale: float | None = None
    source: str = "the calibration given"


def say_unit(name: str, calibration: Calibration, usual: float) -> None:
    """Logs that a file's unit of depth counts, where it is not that of the recording's layout.

    Args:
        name: of the recording.
        calibration: the file's content.
        usual: units per metre of the layout.
    """
    scale = calibration.depth_scale
    # 1 is for floats, as in ORB-SLAM's
    if scale is not None and scale != 1 and not math.isclose(scale * usual, 1.0):
        logger.info(
            "%s: depth is in units of 1/%g m by the factor in %s, and not of 1/%g m as usual",
            *(name, 1 / scale, calibration.source, usual),
        )


def read_calibration(path: Path) -> Calibration:
    """The content of a calibration file.

    Raises:
        InputError: the file cannot be read, contains no camera or several, or its numbers are
            impossible for a camera.
    """
    return calibration_among(path, _OF_COLOR)


def calibration_among(path: Path, of: re.Pattern[str]) -> Calibration:
    """As ``read_calibration``, and of several cameras the one with a name that ``of`` finds.

    Raises:
        InputError: the file cannot be read, contains no camera or several, or its numbers are
            impossible for a camera.
    """
    try:
        content = _content(read_text(path))
    except InputError:
        raise  # it says by itself what is wrong
    except (yaml.YAMLError, RecursionError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(path, f"cannot be read ({reason})", "give a YAML or JSON file") from error
    cameras = list(_cameras("", content))
    if len(cameras) > 1:
        named = [camera for camera in cameras if of.search(camera[0])]
        cameras = named if len(named) == 1 else cameras
    if len(cameras) > 1:
        names = ", ".join(name or "one without a name" for name, _ in cameras)
        raise InputError(
            path, f"holds {len(cameras)} cameras ({names})", "keep only the colour camera"
        )
    if not cameras:
        raise InputError(path, "is not a camera calibration", _REMEDY)
    values = cameras[0][1]
    try:
        info, depth_scale = _camera_info(values), _depth_scale(values, content)
    except (KeyError, OverflowError, TypeError, ValueError) as error:
        raise InputError(path, f"is not a camera calibration ({error})", _REMEDY) from error
    return Calibration(intrinsics_from_message(info, str(path)), depth_scale, str(path))


def _content(text: str) -> Any:
    """The tree of a YAML or JSON file, or the numbers of a text."""
    numbers = _numbers(text)
    if numbers is not None:
        # ARKitScenes writes width and height before the four
        return (
            {"resolution": numbers[:-4], "k": numbers[-4:]} if len(numbers) == 6 else {"k": numbers}
        )
    # for duplicate keys the YAML error gives the line
    with suppress(ValueError):
        return json.loads(text, object_pairs_hook=_each_once)
    named = ost_camera(text) or colmap_cameras(text) or bundle_fusion_cameras(text)
    if named is not None:
        return named
    # YAML 1.0 as OpenCV writes it begins with a line that YAML 1.1 does not know
    plain = re.sub(r"^%.*$", "", text, flags=re.MULTILINE).expandtabs(4)
    return next((part for part in documents(plain, _Loader) if part is not None), None)


def _numbers(text: str) -> list[float] | None:
    """All numbers of a text, None if it contains anything else."""
    words = re.sub(r"[\[\](),;]", " ", re.sub(r"#.*", "", text)).split()
    try:
        return [float(word) for word in words] or None
    except ValueError:
        return None


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        raise ValueError("a name is given twice")
    return content


class _Loader(BoundedLoader):
    """Reads OpenCV's matrices as plain mappings."""


def _mapping(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[Any, Any]:
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _mapping)


def _cameras(name: str, content: Any) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Name and values of every camera in a tree."""
    if not isinstance(content, Mapping):
        return
    values = _named_plainly(content)
    if _first(values, _FOCAL_AND_CENTRE[0]) is not None or any(
        isinstance(values.get(key), list) or _is_matrix(values.get(key)) for key in _MATRIX
    ):
        yield name, values
        return
    for key, value in content.items():
        yield from _cameras(str(key), value)


def _is_matrix(value: Any) -> bool:
    return isinstance(value, Mapping) and "data" in value


def _named_plainly(content: Mapping[Any, Any]) -> dict[str, Any]:
    """Names in lower case, without ORB-SLAM's prefix."""
    return {
        re.sub(r"^(camera1?|rgbd)\.", "", str(key).lower()): value for key, value in content.items()
    }


def _first(values: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    return next((values[name] for name in names if name in values), None)


def _camera_info(values: Mapping[str, Any]) -> CameraInfo:
    width, height = _size(values)
    model = str(_first(values, _MODEL) or "")
    kind = str(_first(values, _KIND) or "")
    if kind.lower() in _UNKNOWN_CAMERAS:
        raise ValueError(f"camera model {kind!r} is not supported")
    return CameraInfo(
        header=header(0, ""),
        height=height,
        width=width,
        distortion_model=model,
        d=_coefficients(values, model),
        k=_matrix(values).ravel(),
        r=np.eye(3).ravel(),
        p=np.zeros(12),
    )


def _size(values: Mapping[str, Any]) -> tuple[int, int]:
    """Width and height; 0 if not given."""
    both = _first(values, _SIZE)
    if both is not None:
        return int(both[0]), int(both[1])
    names = [next((name for name in side if name in values), None) for side in (_WIDTH, _HEIGHT)]
    width, height = (0 if name is None else int(values[name]) for name in names)
    return width, height


def _matrix(values: Mapping[str, Any]) -> Float64:
    """The camera matrix [3, 3]."""
    fx, fy, cx, cy = (_first(values, names) for names in _FOCAL_AND_CENTRE)
    if fx is None:
        numbers = _array(_first(values, _MATRIX))
        if numbers.size != 4:
            return _of_matrix(numbers)
        fx, fy, cx, cy = numbers
        if abs(fx - fy) > _NEARLY_ONE * fx and abs(fx - cx) < _NEARLY_ONE * fx:
            fx, cx, fy, cy = numbers  # as OpenLORIS has it
    # some calibrate one focal length
    return np.array([[fx, 0, cx], [0, fx if fy is None else fy, cy], [0, 0, 1]], np.float64)


def _of_matrix(numbers: Float64) -> Float64:
    """The camera matrix from 9, 12 (P) or 16 numbers, by rows or by columns."""
    shapes = {9: (3, 3), 12: (3, 4), 16: (4, 4)}
    if numbers.size not in shapes:
        raise ValueError(f"a camera matrix of {numbers.size} numbers")
    K = numbers.reshape(shapes[numbers.size])[:3, :3]
    # the centre is in the last column; if it is in the last row, columns were written
    return K.T if K[2, :2].any() and not K[:2, 2].any() else K


def _coefficients(values: Mapping[str, Any], model: str) -> Float64:
    given = _first(values, _COEFFICIENTS)
    if given is not None:
        return _array(given)
    is_fisheye = "kannala" in model.lower() or "fisheye" in model.lower() or "equi" in model.lower()
    names = _EQUIDISTANT if is_fisheye else _PLUMB_BOB
    return np.array([float(values.get(name, 0)) for name in names])


def _array(value: Any) -> Float64:
    """The numbers in a list, in a list of rows, or under ``data``."""
    numbers: Float64 = np.array(value["data"] if _is_matrix(value) else value, np.float64).ravel()
    return numbers


def _depth_scale(camera: Mapping[str, Any], content: Mapping[str, Any]) -> float | None:
    """Metres per unit; some files give it beside the camera."""
    beside = _named_plainly(content)
    scale = _first(camera, _DEPTH_SCALE) or _first(beside, _DEPTH_SCALE)
    return None if scale is None else metres_per_unit(float(scale))
