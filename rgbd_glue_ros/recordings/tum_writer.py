"""Writes frames and true poses to a folder in the layout of TUM RGB-D."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.stamp_text import format_stamp
from rgbd_glue_ros.messages.fields import distortion_model
from rgbd_glue_ros.messages.image_codecs import encode_png, quantised
from rgbd_glue_ros.recordings.tum import (
    CALIBRATION,
    COLOR_LIST,
    DEPTH_LIST,
    GROUND_TRUTH,
    UNITS_PER_METRE,
)
from rgbd_glue_ros.trajectories.tum import write_tum
from rgbd_glue_ros.types import CameraIntrinsics, RgbdFrame, Trajectory

_COLOR_FOLDER, _DEPTH_FOLDER = "rgb", "depth"


@dataclass(frozen=True)
class EncodedFrame:
    """The files of a frame: PNG."""

    stamp_ns: int
    color: bytes
    depth_stamp_ns: int
    depth: bytes


class TumFolderWriter(Closing):
    """A folder under construction: everything that its lists name is completely on disk."""

    def __init__(self, folder: Path, camera: CameraIntrinsics, truth: Trajectory | None) -> None:
        """Creates the folder, with the calibration and the true poses.

        Args:
            folder: must not exist.
            camera: of all frames.
            truth: T_world_camera of the optical frame, None if not known.

        Raises:
            InputError: the folder exists or cannot be written.
        """
        self._folder = folder
        try:
            folder.mkdir(parents=True)
            for name in (_COLOR_FOLDER, _DEPTH_FOLDER):
                (folder / name).mkdir()
        except OSError as error:
            raise InputError(
                folder, f"cannot be created ({error.strerror})", "give a new folder"
            ) from error
        (folder / CALIBRATION).write_text(_calibration(camera), encoding="utf-8")
        if truth is not None:
            write_tum(folder / GROUND_TRUTH, truth)
        self._colors = (folder / COLOR_LIST).open("w", encoding="ascii", buffering=1)
        self._depths = (folder / DEPTH_LIST).open("w", encoding="ascii", buffering=1)

    def encode(self, frame: RgbdFrame) -> EncodedFrame:
        """Does the slow part of writing a frame; any thread may call it.

        Depth is rounded to a fifth of a millimetre, and unknown beyond 13 m.
        """
        color = frame.color
        if color.ndim == 3:
            color = np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2BGR), np.uint8)
        return EncodedFrame(
            frame.stamp_ns,
            encode_png(color),
            frame.stamp_ns + frame.depth_delay_ns,
            encode_png(quantised(frame.depth, UNITS_PER_METRE)),
        )

    def write(self, frame: EncodedFrame) -> None:
        """Adds a frame."""
        for folder, stamp_ns, data, names in (
            (_COLOR_FOLDER, frame.stamp_ns, frame.color, self._colors),
            (_DEPTH_FOLDER, frame.depth_stamp_ns, frame.depth, self._depths),
        ):
            stamp = format_stamp(stamp_ns)
            name = f"{folder}/{stamp}.png"
            (self._folder / name).write_bytes(data)
            names.write(f"{stamp} {name}\n")

    def close(self) -> None:
        """Closes the lists."""
        self._colors.close()
        self._depths.close()


def _calibration(camera: CameraIntrinsics) -> str:
    """As the ROS package camera_calibration writes it."""
    return yaml.safe_dump(
        {
            "image_width": camera.width,
            "image_height": camera.height,
            "distortion_model": distortion_model(camera),
            "camera_matrix": {"rows": 3, "cols": 3, "data": camera.matrix.ravel().tolist()},
            "distortion_coefficients": {
                "rows": 1,
                "cols": len(camera.distortion),
                "data": list(camera.distortion),
            },
        },
        sort_keys=False,
    )
