"""Writes frames, true poses and accelerations to a folder in the layout of TUM RGB-D."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.stamp_text import format_stamp
from rgbd_glue_ros.messages.image_codecs import encode_png, quantised
from rgbd_glue_ros.messages.making import distortion_model
from rgbd_glue_ros.recordings.depth_encoding import TUM_UNITS_PER_METRE
from rgbd_glue_ros.recordings.tum import (
    ACCELEROMETER,
    CALIBRATION,
    COLOR_LIST,
    DEPTH_LIST,
    GROUND_TRUTH,
    R_OPTICAL_ACCELEROMETER,
)
from rgbd_glue_ros.trajectories.tum import write_tum
from rgbd_glue_ros.types import CameraIntrinsics, ImuSamples, RgbdFrame, Trajectory

logger = logging.getLogger(__name__)

_COLOR_FOLDER, _DEPTH_FOLDER = "rgb", "depth"

# The largest number of 16 bits stands for none
_FARTHEST_UNITS = np.iinfo(np.uint16).max - 1


@dataclass(frozen=True)
class FrameFiles:
    """The files of a frame: PNG.

    Attributes:
        stamp_ns: of colour.
        color: the image.
        depth_stamp_ns: of depth.
        depth: the image.
        known: pixels of known depth.
        too_far: those of them that the unit of depth does not reach, unknown in the image.
    """

    stamp_ns: int
    color: bytes
    depth_stamp_ns: int
    depth: bytes
    known: int
    too_far: int


class TumFolderWriter(Closing):
    """A folder under construction: everything that its lists name is completely on disk."""

    def __init__(
        self,
        folder: Path,
        camera: CameraIntrinsics,
        truth: Trajectory | None,
        imu: ImuSamples | None = None,
        units_per_metre: int = TUM_UNITS_PER_METRE,
    ) -> None:
        """Creates the folder, with the calibration, the true poses and the accelerations.

        The layout has no place for angular velocities; that they are left out is logged.

        Args:
            folder: must not exist.
            camera: of all frames.
            truth: T_world_camera of the optical frame, None if not known.
            imu: samples in the axes of the optical frame, None if there are none.
            units_per_metre: of depth; one that is not TUM's is in a comment of the list of depth
                images.

        Raises:
            InputError: the folder exists or cannot be written.
        """
        self._folder = folder
        self._units_per_metre = units_per_metre
        self._known = self._too_far = 0
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
        if imu is not None:
            self._write_accelerations(imu)
        self._colors = (folder / COLOR_LIST).open("w", encoding="ascii", buffering=1)
        self._depths = (folder / DEPTH_LIST).open("w", encoding="ascii", buffering=1)
        if units_per_metre != TUM_UNITS_PER_METRE:
            self._depths.write(f"# depth scale: {units_per_metre}\n")

    @property
    def farthest_m(self) -> float:
        """The largest depth that can be written."""
        return _FARTHEST_UNITS / self._units_per_metre

    def encode(self, frame: RgbdFrame) -> FrameFiles:
        """Does the slow part of writing a frame; any thread may call it.

        Depth is rounded to the unit, TUM's a fifth of a millimetre, and unknown beyond
        ``farthest_m``, with TUM's 13.1 m.
        """
        color = frame.color
        if color.ndim == 3:
            color = np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2BGR), np.uint8)
        return FrameFiles(
            frame.stamp_ns,
            encode_png(color),
            frame.stamp_ns + frame.depth_delay_ns,
            encode_png(quantised(frame.depth, self._units_per_metre)),
            int(np.count_nonzero(frame.depth > 0)),
            int(np.count_nonzero(frame.depth > self.farthest_m)),
        )

    def write(self, frame: FrameFiles) -> None:
        """Adds a frame."""
        for folder, stamp_ns, data, names in (
            (_COLOR_FOLDER, frame.stamp_ns, frame.color, self._colors),
            (_DEPTH_FOLDER, frame.depth_stamp_ns, frame.depth, self._depths),
        ):
            stamp = format_stamp(stamp_ns)
            name = f"{folder}/{stamp}.png"
            (self._folder / name).write_bytes(data)
            names.write(f"{stamp} {name}\n")
        self._known += frame.known
        self._too_far += frame.too_far

    def say_what_is_lost(self) -> None:
        """Logs how much depth of the frames so far was too far."""
        if self._too_far:
            logger.warning(
                "%s: %.2g %% of its depth is beyond %.1f m, where whole units of 1/%d m end, and "
                "was left out",
                *(self._folder.name, 100 * self._too_far / self._known),
                *(self.farthest_m, self._units_per_metre),
            )

    def _write_accelerations(self, imu: ImuSamples) -> None:
        if np.isfinite(imu.linear_acceleration).any():
            (self._folder / ACCELEROMETER).write_text(_accelerations(imu), encoding="ascii")
        if np.isfinite(imu.angular_velocity).any():
            logger.warning(
                "%s: has no place for the angular velocities of the IMU", self._folder.name
            )

    def close(self) -> None:
        """Closes the lists."""
        self._colors.close()
        self._depths.close()


def _accelerations(imu: ImuSamples) -> str:
    """Lines of a stamp and an acceleration, of the samples that have one."""
    lines = ["# timestamp ax ay az\n"]
    measured = imu.rotated(R_OPTICAL_ACCELEROMETER.T)
    for stamp_ns, acceleration in zip(
        measured.stamps_ns.tolist(), measured.linear_acceleration.tolist(), strict=True
    ):
        if np.isfinite(acceleration).all():
            lines.append(f"{format_stamp(stamp_ns)} {' '.join(map(repr, acceleration))}\n")
    return "".join(lines)


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
