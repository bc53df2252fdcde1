"""Camera calibration files: the format of ROS camera_calibration, or a CameraInfo as text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.types import CameraIntrinsics

_MODELS = ("", "plumb_bob", "rational_polynomial")


def load_calibration(path: Path) -> CameraIntrinsics:
    """The camera in a YAML or JSON file.

    Either as ``camera_calibration`` writes it (``camera_matrix: {data: […]}``) or as
    ``ros2 topic echo`` prints a CameraInfo message (``k: […]``).

    Raises:
        InputError: the file cannot be read, lacks a field, or the numbers are no pinhole camera.
    """
    try:
        content = next(iter(yaml.safe_load_all(path.read_text(encoding="utf-8"))))
        width, height, K, distortion, model = _fields(content)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(path, f"cannot be read ({reason})", "give a YAML or JSON file") from error
    except (KeyError, TypeError, ValueError, StopIteration) as error:
        raise InputError(
            path,
            f"is no camera calibration ({error})",
            "give image_width, image_height, camera_matrix and distortion_coefficients",
        ) from error
    if model not in _MODELS:
        raise InputError(
            path, f"distortion model {model!r} is not supported", "rectify the images first"
        )
    if min(width, height) <= 0 or min(K[0], K[4]) <= 0:
        raise InputError(path, "size and focal lengths must be positive", "calibrate the camera")
    return CameraIntrinsics(
        width, height, K[0], K[4], K[2], K[5], tuple(distortion) if any(distortion) else ()
    )


def _fields(content: Any) -> tuple[int, int, list[float], list[float], str]:
    if "camera_matrix" in content:
        size = int(content["image_width"]), int(content["image_height"])
        K, D = content["camera_matrix"]["data"], content["distortion_coefficients"]["data"]
    else:
        size = int(content["width"]), int(content["height"])
        K = content["k"] if "k" in content else content["K"]
        D = content["d"] if "d" in content else content["D"]
    if len(K) != 9:
        raise ValueError("the camera matrix has not 9 values")
    return *size, [float(v) for v in K], [float(v) for v in D], str(content["distortion_model"])
