"""The formats of recordings, and which of them a path is of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings import icl_nuim, scannet, seven_scenes, tum
from rgbd_glue_ros.recordings.bag import layout
from rgbd_glue_ros.recordings.bag.recording import BagRecording, Topics
from rgbd_glue_ros.recordings.folder import recording as image_folder
from rgbd_glue_ros.recordings.recording import Recording
from rgbd_glue_ros.recordings.reduced import ReducedRecording
from rgbd_glue_ros.types import CameraIntrinsics


@dataclass(frozen=True)
class Format:
    """A kind of recording.

    Attributes:
        name: of the format.
        signature: what it is known by, in words.
        matches: whether a path is of this format.
        open: opens it, given topics (of a bag, or the names of images), the camera if known, and
            how images are understood.
    """

    name: str
    signature: str
    matches: Callable[[Path], bool]
    open: Callable[[Path, Topics | None, CameraIntrinsics | None, InputConfig], Recording]


def _open_tum(
    path: Path, _: Topics | None, camera: CameraIntrinsics | None, inputs: InputConfig
) -> Recording:
    return tum.open_tum(path, camera).with_depth_scale(inputs.metres_per_unit)


def _open_icl(
    path: Path, _: Topics | None, camera: CameraIntrinsics | None, inputs: InputConfig
) -> Recording:
    return icl_nuim.open_icl_nuim(path, camera).with_depth_scale(inputs.metres_per_unit)


def _open_seven(
    path: Path, _: Topics | None, camera: CameraIntrinsics | None, inputs: InputConfig
) -> Recording:
    return seven_scenes.open_seven_scenes(path, camera).with_depth_scale(inputs.metres_per_unit)


def _open_scannet(
    path: Path, _: Topics | None, camera: CameraIntrinsics | None, inputs: InputConfig
) -> Recording:
    return scannet.open_scannet(path, camera).with_depth_scale(inputs.metres_per_unit)


def _open_folder(
    path: Path, topics: Topics | None, camera: CameraIntrinsics | None, inputs: InputConfig
) -> Recording:
    wanted = topics or Topics()
    recording = image_folder.open_folder(path, camera, wanted.color, wanted.depth)
    return recording.with_depth_scale(inputs.metres_per_unit)


FORMATS = (
    Format("TUM RGB-D", "rgb.txt and depth.txt", tum.matches, _open_tum),
    Format(
        "ICL-NUIM", f"{icl_nuim.ASSOCIATIONS} and {icl_nuim.TRUTH}", icl_nuim.matches, _open_icl
    ),
    Format("7-Scenes or 3DMatch", "frame-*.color.*", seven_scenes.matches, _open_seven),
    Format("ScanNet", scannet.SIGNATURE, scannet.matches, _open_scannet),
    Format("rosbag", layout.SIGNATURE, layout.is_bag, BagRecording),
    Format("images", image_folder.SIGNATURE, image_folder.matches, _open_folder),
)


def format_of(path: Path) -> Format | None:
    """The format that what is at a path looks like; None if it is like none of them."""
    return next((kind for kind in FORMATS if kind.matches(path)), None)


def open_recording(
    path: Path,
    topics: Topics | None = None,
    calibration: CameraIntrinsics | None = None,
    inputs: InputConfig | None = None,
) -> Recording:
    """Opens a recording of any known format.

    Args:
        path: a bag, or the folder of a data set.
        topics: of a bag; None finds them by type and name.
        calibration: of the camera; None takes what the recording says.
        inputs: how images are understood and paired; None as by default.

    Raises:
        InputError: there is nothing there, it is of no known format, or it cannot be used.
    """
    if not path.exists():
        raise InputError(path, "does not exist", "give a bag or the folder of a data set")
    kind = format_of(path)
    if kind is not None:
        inputs = inputs or InputConfig()
        recording = kind.open(path, topics, calibration, inputs)
        return ReducedRecording(recording, inputs.max_width) if inputs.max_width else recording
    several = layout.separate_bags(path)
    if several:
        names = ", ".join(file.name for file in several)
        raise InputError(path, f"holds several recordings: {names}", "give one of them")
    looked_for = "; ".join(f"{kind.signature} ({kind.name})" for kind in FORMATS)
    raise InputError(path, "is no recording of a known format", f"looked for {looked_for}")
