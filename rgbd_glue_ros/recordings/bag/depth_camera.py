"""The depth camera of a bag whose depth is not registered to colour: its info and its place."""

from __future__ import annotations

import logging
from typing import Any

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry.depth_registration import DepthCamera
from rgbd_glue_ros.messages.camera_info import INFO_TYPES, intrinsics_of
from rgbd_glue_ros.messages.depth_camera import depth_camera
from rgbd_glue_ros.messages.frame import FrameTopics
from rgbd_glue_ros.messages.images import base_name
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import plain_frame
from rgbd_glue_ros.messages.synchronizer import Match
from rgbd_glue_ros.messages.transform_tree import TransformTree
from rgbd_glue_ros.recordings.bag import realsense
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.types import Float64

logger = logging.getLogger(__name__)

STATIC_TRANSFORMS = "/tf_static"


class RecordedDepthCamera:
    """What a bag tells of the camera that took its depth images.

    Attributes:
        topics: those of the sequence, with that of the depth camera's info.
        metres_per_unit: of the depth images; None where the bag does not tell.
    """

    def __init__(self, bag: BagFile, topics: FrameTopics) -> None:
        """Reads the first camera info beside the depth images, and the static transforms.

        Raises:
            InputError: a bag of the RealSense SDK does not tell where its depth camera is.
        """
        self.metres_per_unit: float | None = None
        self._T_color_depth: Float64 | None = None
        if realsense.is_realsense(topics.depth):
            self._read_realsense(bag, topics)
            return
        namespace = base_name(topics.depth).rpartition("/")[0]
        beside = [
            topic.name
            for topic in bag.topics.values()
            if topic.type.rpartition("/")[2] in INFO_TYPES
            and topic.name.rpartition("/")[0] == namespace
            and topic.name != topics.info
        ]
        self.topics = topics
        self._info: Any = None
        self._transforms = TransformTree()
        if len(beside) != 1:
            return
        self.topics = FrameTopics(topics.color, topics.depth, topics.info, beside[0])
        try:
            self._info = bag.deserialize(next(bag.messages(beside)))
            self._read_transforms(bag)
        except InputError as error:
            logger.warning("%s; taking depth as registered to colour", error)
            self._info = None

    def _read_realsense(self, bag: BagFile, topics: FrameTopics) -> None:
        info_topic = realsense.depth_info_topic(topics.depth)
        self.topics = FrameTopics(topics.color, topics.depth, topics.info, info_topic)
        self.metres_per_unit = realsense.metres_per_unit(bag, topics.depth)
        self._info = None
        if info_topic in bag.topics:
            self._info = bag.deserialize(next(bag.messages([info_topic])))
            self._T_color_depth = realsense.T_color_depth(bag, topics.color, topics.depth)

    def _read_transforms(self, bag: BagFile) -> None:
        if STATIC_TRANSFORMS not in bag.topics:
            return
        for message in bag.messages([STATIC_TRANSFORMS]):
            for item in bag.deserialize(message).transforms:
                parent, child = plain_frame(item.header.frame_id), plain_frame(item.child_frame_id)
                T_parent_child = pose_from_message(item, STATIC_TRANSFORMS)
                self._transforms.add(parent, child, T_parent_child, None)

    def of(self, match: Match[Any]) -> DepthCamera | None:
        """The camera that took a depth image; None if it is registered, or the bag does not tell.

        Unlike a live camera, a recording cannot be made anew: what may be registered is taken as
        it is.
        """
        if self._info is None:
            return None
        if self._T_color_depth is not None:
            # frames have no names there, and depth is never registered
            camera = intrinsics_of(self._info, self.topics.depth, self.topics.depth_info)
            return DepthCamera(camera, self._T_color_depth)
        try:
            return depth_camera(
                match.color, match.depth, match.info, self._info, self._find_transform, self.topics
            )
        except InputError:
            return None

    def _find_transform(self, color_frame: str, depth_frame: str) -> Float64 | None:
        return self._transforms.lookup(plain_frame(color_frame), plain_frame(depth_frame), None, 0)
