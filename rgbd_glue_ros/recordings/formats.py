"""The formats of recordings, and which of them a path has."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import visible
from rgbd_glue_ros.geometry.depth_registration import DepthCamera
from rgbd_glue_ros.messages.poses import pose_parameter
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings import icl_nuim, scannet, seven_scenes, stray_scanner, tum
from rgbd_glue_ros.recordings.bag import layout
from rgbd_glue_ros.recordings.bag.recording import BagRecording, Topics
from rgbd_glue_ros.recordings.calibration import Calibration, say_unit
from rgbd_glue_ros.recordings.depth_encoding import TUM_UNITS_PER_METRE
from rgbd_glue_ros.recordings.folder import recording as image_folder
from rgbd_glue_ros.recordings.image_sequence import ImageSequence
from rgbd_glue_ros.recordings.nearest import explain_unknown
from rgbd_glue_ros.recordings.recording import Recording
from rgbd_glue_ros.recordings.reduced import ReducedRecording
from rgbd_glue_ros.types import CameraIntrinsics
from rgbd_glue_ros.types.checks import check_class

logger = logging.getLogger(__name__)

# In a larger folder, this many entries are examined for recordings
_LOOKED_AT = 100


@dataclass(frozen=True)
class Given:
    """What a user specifies about a recording.

    Attributes:
        topics: of a bag, or the names of images; those that are None are detected.
        calibration: of the colour images; None uses the recording's.
        depth_calibration: of the depth images, if they are not registered to colour.
        inputs: how images are interpreted and paired.
    """

    topics: Topics
    calibration: Calibration | None
    depth_calibration: CameraIntrinsics | None
    inputs: InputConfig

    @property
    def camera(self) -> CameraIntrinsics | None:
        """The camera of the colour images; None uses the recording's."""
        return None if self.calibration is None else self.calibration.intrinsics

    @property
    def calibration_depth_scale(self) -> float | None:
        """Metres per unit of depth from the calibration; None if it does not give them."""
        return None if self.calibration is None else self.calibration.depth_scale

    @property
    def depth_camera(self) -> DepthCamera | None:
        """The camera of depth images in a folder; None if they are registered."""
        if self.depth_calibration is None or self.inputs.depth_is_registered:
            return None
        T = pose_parameter("depth_camera_pose", self.inputs.depth_camera_pose)
        if T is None:
            logger.warning(
                "the pose of the depth camera is assumed to be that of the colour camera; if it is "
                "not, give --set depth_camera_pose='x y z roll pitch yaw', between the optical "
                "frames"
            )
            T = np.eye(4)
        return DepthCamera(self.depth_calibration, T)


@dataclass(frozen=True)
class Format:
    """A kind of recording.

    Attributes:
        name: of the format.
        matches: whether a path is of this format.
        open: opens it, given the user's specification.
    """

    name: str
    matches: Callable[[Path], bool]
    open: Callable[[Path, Given], Recording]


def _open_tum(path: Path, given: Given) -> Recording:
    return _understood(tum.open_tum(path, given.camera), given)


def _open_icl(path: Path, given: Given) -> Recording:
    return _understood(icl_nuim.open_icl_nuim(path, given.camera), given)


def _open_seven(path: Path, given: Given) -> Recording:
    return _understood(seven_scenes.open_seven_scenes(path, given.camera), given)


def _open_scannet(path: Path, given: Given) -> Recording:
    scan = scannet.open_scannet(path, given.camera)
    if isinstance(scan, ImageSequence):
        return _understood(scan, given)
    if given.depth_calibration is not None:
        scan.close()
        raise InputError("--depth-calibration", f"{path} holds aligned images", "leave it out")
    unit = given.inputs.metres_per_unit
    if unit is None and given.calibration is not None:
        say_unit(scan.name, given.calibration, scan.encoding.units_per_metre)
        scan.encoding = scan.encoding.with_calibration_depth_scale(given.calibration_depth_scale)
    scan.encoding = scan.encoding.with_scale(unit)
    return scan


def _open_folder(path: Path, given: Given) -> Recording:
    is_unit_told = (
        given.inputs.metres_per_unit is not None or given.calibration_depth_scale is not None
    )
    if tum.has_lost_its_lists(path) and not is_unit_told:
        raise InputError(
            path,
            f"lacks {tum.COLOR_LIST} and {tum.DEPTH_LIST} of a TUM data set, so the unit of its "
            "depth is unknown",
            f"restore them, or give it: --set depth_scale={1 / TUM_UNITS_PER_METRE:g} as in TUM, "
            "--set depth_scale=0.001 for millimetres",
        )
    recording = image_folder.open_folder(
        path, given.camera, given.topics.color, given.topics.depth, given.depth_camera
    )
    return _understood(recording, given)


def _open_stray(path: Path, given: Given) -> Recording:
    images = stray_scanner.open_images(path, given.camera)
    return stray_scanner.VideoSequence(_understood(images, given))


def _open_bag(path: Path, given: Given) -> Recording:
    return BagRecording(
        path,
        given.topics,
        given.camera,
        given.inputs,
        given.depth_calibration,
        given.calibration_depth_scale,
    )


def _understood(sequence: ImageSequence, given: Given) -> ImageSequence:
    """The sequence with the given information about its depth."""
    if given.inputs.metres_per_unit is None:
        if given.calibration is not None:
            say_unit(sequence.name, given.calibration, sequence.encoding.units_per_metre)
        sequence = sequence.with_calibration_depth_scale(given.calibration_depth_scale)
    sequence = sequence.with_depth_scale(given.inputs.metres_per_unit)
    return sequence.with_depth_camera(given.depth_camera)


IMAGES = Format("images", image_folder.matches, _open_folder)
FORMATS = (
    Format("TUM RGB-D", tum.matches, _open_tum),
    Format("ICL-NUIM", icl_nuim.matches, _open_icl),
    Format("7-Scenes or 3DMatch", seven_scenes.matches, _open_seven),
    Format("ScanNet", scannet.matches, _open_scannet),
    Format("Stray Scanner", stray_scanner.matches, _open_stray),
    Format("rosbag", layout.is_bag, _open_bag),
    IMAGES,
)


def format_of(path: Path) -> Format | None:
    """The format that a path appears to have; None if there is none."""
    return next((kind for kind in FORMATS if kind.matches(path)), None)


def refuse_recording(output: Path) -> None:
    """Refuses a recording's folder for results: they would mix with it, or replace its files.

    Raises:
        InputError: the folder is a recording.
    """
    if output.is_dir() and format_of(output) is not None:
        raise InputError(output, "is a recording", "give another folder for the results (-o)")


def open_recording(
    path: str | Path,
    topics: Topics | None = None,
    calibration: CameraIntrinsics | Calibration | None = None,
    inputs: InputConfig | None = None,
    depth_calibration: CameraIntrinsics | Calibration | None = None,
) -> Recording:
    """Opens a recording of any known format.

    Args:
        path: a bag, or the folder of a data set.
        topics: of a bag; None finds them by type and name.
        calibration: of the camera, or the content of a file on it and the unit of depth; None uses
            the recording's.
        inputs: how images are interpreted and paired; None for the defaults.
        depth_calibration: of the depth camera, if depth is not registered to colour.

    Raises:
        InputError: the path does not exist, has no known format, or is unusable.
    """
    check_class("open_recording.path", path, (str, Path), "a bag or the folder of a data set")
    path = Path(path)
    if not path.exists():
        raise InputError(path, "does not exist", "give a bag or the folder of a data set")
    if not (path.is_dir() or path.is_file()):
        raise InputError(path, "is not a regular file", "give a bag or the folder of a data set")
    kind = format_of(path)
    if kind is None and path.is_dir() and topics and topics.color and topics.depth:
        kind = IMAGES  # whatever they are called
    if kind is not None:
        inputs = inputs or InputConfig()
        if isinstance(calibration, CameraIntrinsics):
            calibration = Calibration(calibration)
        if isinstance(depth_calibration, Calibration):
            depth_calibration = depth_calibration.intrinsics
        given = Given(topics or Topics(), calibration, depth_calibration, inputs)
        recording = kind.open(path, given)
        return ReducedRecording(recording, inputs.max_width) if inputs.max_width else recording
    several = layout.separate_bags(path)
    if several:
        names = ", ".join(file.name for file in several)
        raise InputError(path, f"holds several recordings: {names}", "give one of them")
    below = islice(visible(path), _LOOKED_AT) if path.is_dir() else ()
    raise explain_unknown(path, [child for child in below if format_of(child) is not None])
