"""A folder of colour and depth images with none of the published layouts.

Frames are defined by lists, by an association file or by the names of the images; camera, unit of
depth and ground truth by files in the folder.
"""

from __future__ import annotations

import logging
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import visible
from rgbd_glue_ros.geometry.depth_registration import DepthCamera
from rgbd_glue_ros.messages.camera_info import of_image_size
from rgbd_glue_ros.recordings.calibration import Calibration, say_unit
from rgbd_glue_ros.recordings.depth_encoding import MILLIMETRES, TUM, DepthEncoding
from rgbd_glue_ros.recordings.folder import lists, streams
from rgbd_glue_ros.recordings.folder.calibration import calibration_of
from rgbd_glue_ros.recordings.folder.truth import truth_of
from rgbd_glue_ros.recordings.image_sequence import (
    ImagePair,
    ImagePairs,
    ImageSequence,
    first_readable,
)
from rgbd_glue_ros.types import CameraIntrinsics

logger = logging.getLogger(__name__)

# SUN3D rotates the bits of its millimetres
_SUN3D = replace(MILLIMETRES, rotation=3)
# The disparity that a Kinect sends where it sees nothing
_NO_DISPARITY = 2047
_SUN3D_EXTRINSICS = re.compile(r"\d{10,}\.txt")


def matches(path: Path) -> bool:
    """Whether there are images of colour and depth, with any names."""
    if not path.is_dir():
        return False
    if lists.lists_in(path) or lists.association_in(path):
        return True
    try:
        return streams.color_and_depth(path, None, None) is not None
    except InputError:
        return True  # ambiguous: reported on opening


def open_folder(
    folder: Path,
    calibration: CameraIntrinsics | None = None,
    color: str | None = None,
    depth: str | None = None,
    depth_camera: DepthCamera | None = None,
) -> ImageSequence:
    """The sequence in ``folder``.

    Args:
        folder: of the recording.
        calibration: of the colour camera; None uses that of a file in the folder.
        color: part of the path of the colour images; None finds them by name.
        depth: part of the path of the depth images; None finds them by name.
        depth_camera: the one that took the depth images; None if they are registered to colour.

    Raises:
        InputError: the images, or their camera, are missing, ambiguous or do not fit.
    """
    found, encoding = _frames(folder, color, depth)
    pairs = found.pairs
    told = _calibration(folder) if calibration is None else Calibration(calibration)
    color_shape, depth_shape = _sizes(pairs)
    if depth_camera is None:
        camera = _fitted(told, color_shape, depth_shape, pairs[0])
    else:
        camera = of_image_size(told.intrinsics, color_shape, told.source, str(pairs[0].color))
    sequence = ImageSequence(
        folder.resolve().name,
        pairs,
        encoding,
        camera,
        truth_of(folder, pairs),
        color_shape[::-1],
        depth_camera=depth_camera,
        left_out=found.left_out,
    )
    say_unit(sequence.name, told, encoding.units_per_metre)
    return sequence.with_calibration_depth_scale(told.depth_scale)


def _frames(folder: Path, color: str | None, depth: str | None) -> tuple[ImagePairs, DepthEncoding]:
    if color is None and depth is None:
        both = lists.lists_in(folder)
        if both is not None:
            is_tum = both[0].name == "rgb.txt" and both[1].name == "depth.txt"
            # the layout of lists is TUM's, and so is their unit
            encoding = TUM if is_tum else MILLIMETRES
            return lists.paired(*both), encoding.with_calibration_depth_scale(
                lists.scale_in_comments(both[1])
            )
        association = lists.association_in(folder)
        if association is not None:
            return lists.read_association(association), TUM
    found = streams.color_and_depth(folder, color, depth)
    if found is None:
        names = streams.named(streams.streams_in(folder))
        raise InputError(
            folder,
            f"has no colour and depth images; its images are {names or 'none'}",
            "name them (--color-topic NAME --depth-topic NAME)",
        )
    is_sun3d = any(
        _SUN3D_EXTRINSICS.fullmatch(p.name) for p in visible(folder / "extrinsics", "*.txt")
    )
    return streams.paired(folder, *found), _SUN3D if is_sun3d else MILLIMETRES


def _calibration(folder: Path) -> Calibration:
    told = calibration_of(folder)
    if told is None:
        raise InputError(
            folder,
            "no file there describes its camera",
            "give the calibration (--calibration FILE), such as a K.txt of 3x3 numbers",
        )
    return told


def _fitted(
    told: Calibration,
    color: tuple[int, int],
    depth: tuple[int, int],
    pair: ImagePair,
) -> CameraIntrinsics:
    """The camera at the size of the depth images; heights and widths of both."""
    camera = told.intrinsics
    if color[::-1] != (camera.width, camera.height) == depth[::-1]:
        # a calibration of the depth images: colour of the same view is reduced to them
        return camera
    camera = of_image_size(camera, color, told.source, str(pair.color))
    return of_image_size(camera, depth, str(pair.color), str(pair.depth))


def _sizes(pairs: tuple[ImagePair, ...]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Height and width of colour and depth images, from the first readable frame."""
    pair, color, depth = first_readable(pairs)
    if pair.depth.suffix.lower() == ".pgm" and _holds_disparities(depth):
        raise InputError(
            pair.depth,
            "holds disparities of a Kinect, as NYU Depth dumps them, in the view of its "
            "infrared camera",
            "project them with the data set's toolbox, and save depth as 16-bit PNG",
        )
    return (color.shape[0], color.shape[1]), (depth.shape[0], depth.shape[1])


def _holds_disparities(depth: NDArray[Any]) -> bool:
    """Whether an image has a Kinect's raw values, which NYU writes in the other byte order."""
    return _NO_DISPARITY in {int(depth.max()), int(depth.byteswap().max())}
