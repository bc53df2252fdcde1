"""The depth camera of a bag whose depth is not registered to colour: its info and its pose."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry.depth_registration import DepthCamera
from rgbd_glue_ros.messages.camera_info import INFO_TYPES, intrinsics_of
from rgbd_glue_ros.messages.depth_camera import (
    GivenDepthCamera,
    find_depth_camera,
    is_same_camera,
)
from rgbd_glue_ros.messages.fields import CameraInfo
from rgbd_glue_ros.messages.frame import FrameTopics, registration_doubt
from rgbd_glue_ros.messages.images import base_name
from rgbd_glue_ros.messages.making import camera_info, header
from rgbd_glue_ros.messages.poses import pose_parameter
from rgbd_glue_ros.messages.reading import frame_of
from rgbd_glue_ros.messages.synchronizer import Match
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings.bag import realsense
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.recordings.bag.transforms import recorded_transform
from rgbd_glue_ros.types import CameraIntrinsics, Float64

logger = logging.getLogger(__name__)

GIVEN = "the given depth calibration"

_GIVE_PLACE = (
    "give --set depth_camera_pose='x y z roll pitch yaw', between the optical frames, or "
    "--set depth_is_registered=true if depth is registered to colour"
)


class RecordedDepthCamera:
    """What a bag says about the camera that took its depth images.

    Attributes:
        topics: those of the sequence, including that of the depth camera's info.
        metres_per_unit: of the depth images; None if neither the user nor the bag says.
    """

    def __init__(
        self,
        bag: BagFile,
        topics: FrameTopics,
        inputs: InputConfig,
        calibration: CameraIntrinsics | None,
        info_topic: str | None,
    ) -> None:
        """Finds the information about the depth camera.

        Args:
            bag: the bag.
            topics: of colour, depth and the colour camera's info.
            inputs: may give the depth camera's pose and unit, or say that depth is registered.
            calibration: of the depth camera; None uses the bag's info.
            info_topic: topic of that info; None uses the one beside the depth images.

        Raises:
            InputError: the given info cannot be read, or ``depth_camera_pose``, or the unit or
                camera in a bag of the RealSense SDK.
        """
        self._bag = bag
        self._is_registered = inputs.depth_is_registered
        self._T_color_depth = pose_parameter("depth_camera_pose", inputs.depth_camera_pose)
        self._is_realsense = realsense.is_realsense(topics.depth)
        self._is_given = calibration is not None or info_topic is not None
        self.metres_per_unit = inputs.metres_per_unit
        if self._is_realsense:
            self.metres_per_unit = self.metres_per_unit or realsense.metres_per_unit(
                bag, topics.depth
            )
            if not self._is_given:
                calibration = realsense.camera_in_text(bag, topics.depth)
        if calibration is not None:
            name: str | None = GIVEN
            self._info: CameraInfo | None = camera_info(calibration, header(0, ""))
        else:
            name = info_topic or self._info_beside(topics)
            self._info = None if name is None else self._info_in(name)
        self.topics = FrameTopics(topics.color, topics.depth, topics.info, name or "camera_info")

    def of(self, match: Match[Any]) -> DepthCamera | None:
        """The camera that took a depth image; None if the image is assumed to be registered.

        Doubtful cases are logged. Unlike with a live camera, a recording cannot be repeated: depth
        that may be registered is used as it is, and a depth camera without a known pose is assumed
        to be at the colour camera.

        Raises:
            InputError: given information does not fit, or a bag of the RealSense SDK does not
                contain the pose of its depth camera.
        """
        if self._is_registered:
            return None
        if self._info is None:
            self._say_what_is_taken_as_registered(match)
            return None
        if self._is_realsense:
            # there depth is never registered, and frames have no names
            T = self._T_color_depth
            if T is None:
                T = realsense.T_color_depth(self._bag, self.topics.color, self.topics.depth)
            return DepthCamera(
                intrinsics_of(self._info, self.topics.depth, self.topics.depth_info), T
            )
        try:
            return self._by_frames(match, self._info)
        except InputError as error:
            if self._is_given:
                raise
            logger.warning(
                "%s: %s; depth is assumed to be registered to colour", error.where, error.cause
            )
            return None

    def _by_frames(self, match: Match[Any], info: CameraInfo) -> DepthCamera | None:
        color_frame, depth_frame = frame_of(match.color.header), frame_of(match.depth.header)
        T = self._place(color_frame, depth_frame)
        doubt = registration_doubt(match.color, match.depth, self.topics)
        if T is None and doubt is not None:
            if is_same_camera(match.info, info, self.topics):
                logger.warning("%s", doubt)
                return None
            logger.warning(
                "%s is of another camera than colour, and the bag does not contain the pose of %s "
                "in %s: it is assumed to be that of the colour camera; %s",
                self.topics.depth,
                depth_frame,
                color_frame,
                _GIVE_PLACE,
            )
            T = np.eye(4)
        found = find_depth_camera(
            *(match.color, match.depth, match.info, info),
            lambda *_: T,
            self.topics,
            GivenDepthCamera(self._T_color_depth, self._is_given),
        )
        if found.note is not None:
            logger.warning("%s", found.note)
        return found.camera

    def _place(self, color_frame: str, depth_frame: str) -> Float64 | None:
        """The pose [4, 4] of the depth camera in that of colour; None if it is not known."""
        if self._T_color_depth is not None:
            return self._T_color_depth
        return recorded_transform(self._bag, color_frame, depth_frame)

    def _say_what_is_taken_as_registered(self, match: Match[Any]) -> None:
        doubt = registration_doubt(match.color, match.depth, self.topics)
        if self._is_realsense:
            doubt = (
                f"{self.topics.depth}: the bag does not contain its camera, so depth is assumed "
                "to be registered to colour; if it is not, give --depth-calibration FILE"
            )
        if doubt is not None:
            logger.warning("%s", doubt)

    def _info_beside(self, topics: FrameTopics) -> str | None:
        """The topic of the only camera info beside the depth images; None if there is none."""
        if self._is_realsense:
            topic = realsense.info_topic(topics.depth)
            return topic if topic in self._bag.topics else None
        namespace = base_name(topics.depth).rpartition("/")[0]
        beside = [
            topic.name
            for topic in self._bag.topics.values()
            if topic.type.rpartition("/")[2] in INFO_TYPES
            and topic.name.rpartition("/")[0] == namespace
            and topic.name != topics.info
        ]
        return beside[0] if len(beside) == 1 else None

    def _info_in(self, topic: str) -> CameraInfo | None:
        """The first info of a topic; None, with a warning, if a detected one cannot be read."""
        try:
            info: CameraInfo = self._bag.first(topic)
        except InputError as error:
            if self._is_given:
                raise
            logger.warning("%s; depth is assumed to be registered to colour", error)
            return None
        return info
