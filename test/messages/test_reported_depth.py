"""Depth beside colour as drivers were reported to publish it, and what is made of it.

Each row is a public report, its sizes reduced to a tenth. A wall at 2 m fills both views.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.depth_camera import find_depth_camera
from rgbd_glue_ros.messages.fields import CameraInfo
from rgbd_glue_ros.messages.frame import FrameTopics, frame_from_messages
from rgbd_glue_ros.messages.making import camera_info, color_image, depth_image, header
from rgbd_glue_ros.types import CameraIntrinsics, Float64

WALL_M = 2.0
ONE, OTHER = "camera_color_optical_frame", "camera_depth_optical_frame"
LENS = (-0.03, 0.035, -1e-5, 1.5e-4, -0.0127)


def pinhole(width: int, height: int, f: float, lens: tuple[float, ...] = ()) -> CameraIntrinsics:
    return CameraIntrinsics(width, height, f, f, (width - 1) / 2, (height - 1) / 2, lens)


@dataclass(frozen=True)
class Report:
    """What a driver publishes; of the images only the sizes.

    Attributes:
        color: the camera in the info of colour.
        depth: the camera in the info of depth.
        frame: of the depth image.
        topic: of the depth image.
        color_size: of the colour image where its info has another; width and height.
        depth_size: the same of depth.
        info: what else the info of depth says.
        is_by_info: whether depth is registered here; else it is taken as it is.
        noted: a part of what is told of that; "" if nothing is.
    """

    color: CameraIntrinsics
    depth: CameraIntrinsics
    frame: str = ONE
    topic: str = "/camera/depth/image_raw"
    color_size: tuple[int, int] | None = None
    depth_size: tuple[int, int] | None = None
    info: tuple[tuple[str, Any], ...] = ()
    is_by_info: bool = False
    noted: str = ""


NO_K: tuple[tuple[str, Any], ...] = (("k", np.zeros(9)),)
UNCALIBRATED = (*NO_K, ("p", np.zeros(12)))
ALIGNED = "/camera/aligned_depth_to_color/image_raw"

REPORTS: dict[str, Report] = {
    # the driver's registered depth has the colour camera's matrix, and no lens
    "OrbbecSDK_ROS1#63": Report(pinhole(128, 72, 61, LENS), pinhole(128, 72, 61)),
    # registered depth beside the info of the depth camera
    "realsense-ros#363": Report(
        pinhole(64, 48, 61),
        pinhole(64, 48, 38),
        topic=ALIGNED,
        noted="registered to colour according to its name",
    ),
    # K of zeros, and a good P
    "depthai-ros#598": Report(pinhole(128, 72, 100), pinhole(128, 72, 100), info=NO_K),
    "depthai-ros#598, with another P": Report(
        pinhole(128, 72, 100),
        pinhole(128, 72, 80),
        info=NO_K,
        is_by_info=True,
        noted="its camera is another one according to",
    ),
    # nothing in the info of depth
    "rtabmap_ros#147": Report(
        pinhole(64, 48, 57),
        pinhole(64, 48, 57),
        info=UNCALIBRATED,
        noted="is not calibrated; /camera/depth/image_raw is assumed registered",
    ),
    # a square preview of colour, cut out of what depth sees whole
    "depthai-ros#643": Report(
        pinhole(50, 50, 40),
        pinhole(128, 72, 60),
        is_by_info=True,
        noted="its camera is another one",
    ),
    # the same, squeezed
    "rtabmap_ros#1245": Report(
        pinhole(128, 72, 60).scaled(50, 50), pinhole(128, 72, 60), is_by_info=True
    ),
    # images of another size than their infos
    "depthai-ros#515": Report(pinhole(192, 108, 150), pinhole(192, 108, 150), color_size=(128, 72)),
    "depthai-ros#45": Report(pinhole(192, 108, 150), pinhole(128, 72, 100)),
    "depthai-ros#426": Report(pinhole(128, 80, 80), pinhole(128, 80, 80), depth_size=(85, 53)),
    # sensors of a simulator, not registered, in one frame
    "rtabmap#880": Report(
        pinhole(64, 48, 55),
        pinhole(128, 72, 65),
        is_by_info=True,
        noted="its camera is another one",
    ),
    "rtabmap_ros#183": Report(
        pinhole(64, 48, 61), pinhole(48, 36, 38), is_by_info=True, noted="its camera is another one"
    ),
    "OrbbecSDK_ROS2#3": Report(
        pinhole(192, 108, 139), pinhole(128, 80, 90), is_by_info=True, noted="its camera is another"
    ),
    # what P holds beyond a camera matrix
    "ros_astra_camera#147": Report(
        pinhole(64, 48, 51),
        pinhole(64, 48, 51),
        topic="/camera/depth/image_rect",
        info=(("p", np.array([51, 0, 31.5, -25.8, 0, 51, 23.5, -0.09, 0, 0, 1, 0.89])),),
    ),
}


def frame_of(report: Report) -> tuple[CameraInfo, CameraInfo, FrameTopics]:
    info = camera_info(report.color, header(1, ONE))
    depth_info = replace(camera_info(report.depth, header(1, report.frame)), **dict(report.info))
    namespace = report.topic.rpartition("/")[0]
    topics = FrameTopics("/color", report.topic, "/info", f"{namespace}/camera_info")
    return info, depth_info, topics


@pytest.mark.parametrize("name", REPORTS)
def test_depth_in_the_frame_of_colour_is_read_whatever_its_info_contains(name: str) -> None:
    report = REPORTS[name]
    info, depth_info, topics = frame_of(report)
    width, height = report.color_size or (report.color.width, report.color.height)
    color = color_image(np.zeros((height, width), np.uint8), header(1, ONE))
    columns, rows = report.depth_size or (report.depth.width, report.depth.height)
    seen = np.full((rows, columns), WALL_M, np.float32)
    depth = depth_image(seen, header(1, report.frame))

    found = find_depth_camera(color, depth, info, depth_info, lambda *_: None, topics)

    assert (found.camera is not None) is report.is_by_info
    assert report.noted in (found.note or "")
    assert bool(found.note) is bool(report.noted)
    frame = frame_from_messages(color, depth, info, topics, found.camera)
    assert frame.depth.shape == (height, width)
    assert frame.depth[height // 2, width // 2] == pytest.approx(WALL_M, rel=1e-5)


@pytest.mark.parametrize("T_color_depth", [None, np.eye(4)])
def test_depth_in_a_frame_with_unknown_pose_is_refused_with_the_parameter_that_accepts_it(
    T_color_depth: Float64 | None,
) -> None:
    """As depthai-ros#628 has it of a simulator: registered depth in a frame that is on no tree."""
    report = Report(pinhole(64, 48, 55), pinhole(64, 48, 55), frame=OTHER)
    info, depth_info, topics = frame_of(report)
    color = color_image(np.zeros((48, 64), np.uint8), header(1, ONE))
    depth = depth_image(np.full((48, 64), WALL_M, np.float32), header(1, OTHER))
    if T_color_depth is None:
        with pytest.raises(InputError, match="if it is registered nevertheless, set depth_is"):
            find_depth_camera(color, depth, info, depth_info, lambda *_: None, topics)
    else:
        found = find_depth_camera(color, depth, info, depth_info, lambda *_: T_color_depth, topics)
        assert found.camera is not None
