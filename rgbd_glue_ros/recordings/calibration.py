"""Camera calibration files: the format of ROS camera_calibration, or a CameraInfo as text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.camera_info import intrinsics_from_message
from rgbd_glue_ros.messages.fields import CameraInfo, header
from rgbd_glue_ros.types import CameraIntrinsics


def load_calibration(path: Path) -> CameraIntrinsics:
    """The camera in a YAML or JSON file.

    Either as ``camera_calibration`` writes it (``camera_matrix: {data: […]}``) or as
    ``ros2 topic echo`` prints a CameraInfo message (``k: […]``).

    Raises:
        InputError: the file cannot be read, lacks a field, or the numbers are no pinhole camera.
    """
    try:
        content = next(yaml.safe_load_all(path.read_text(encoding="utf-8")))
        info = _camera_info(content)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(path, f"cannot be read ({reason})", "give a YAML or JSON file") from error
    except (KeyError, TypeError, ValueError, StopIteration) as error:
        raise InputError(
            path,
            f"is no camera calibration ({error})",
            "give image_width, image_height, camera_matrix, distortion_model and "
            "distortion_coefficients",
        ) from error
    return intrinsics_from_message(info, str(path))


def _camera_info(content: Any) -> CameraInfo:
    if "camera_matrix" in content:
        width, height = content["image_width"], content["image_height"]
        K, D = content["camera_matrix"]["data"], content["distortion_coefficients"]["data"]
    else:
        width, height = content["width"], content["height"]
        # ROS 2 writes small letters, ROS 1 capitals
        K, D = content.get("k", content.get("K")), content.get("d", content.get("D"))
    return CameraInfo(
        header=header(0, ""),
        height=int(height),
        width=int(width),
        distortion_model=str(content["distortion_model"]),
        d=np.array(D, np.float64),
        k=np.array(K, np.float64).reshape(9),
        r=np.eye(3).ravel(),
        p=np.zeros(12),
    )
