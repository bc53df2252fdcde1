"""The samples of an IMU in a bag."""

from __future__ import annotations

import logging

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.imu import imu_reading, imu_samples
from rgbd_glue_ros.messages.poses import pose_parameter
from rgbd_glue_ros.messages.reading import frame_of, stamp_ns
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.recordings.bag.transforms import recorded_transform
from rgbd_glue_ros.recordings.faults import Faults
from rgbd_glue_ros.types import Float64, ImuSamples

logger = logging.getLogger(__name__)


def recorded_imu(
    bag: BagFile, topic: str, color: str, inputs: InputConfig, *, by_receipt: bool
) -> ImuSamples | None:
    """All samples of a topic, in the axes of the camera's optical frame.

    Args:
        bag: the bag.
        topic: of the IMU.
        color: topic of the colour images, whose frame is the camera's.
        inputs: may give the IMU's orientation in the camera.
        by_receipt: whether images go by the time of recording: both must be of one clock.

    Returns:
        None, which is logged, if no message can be read or its orientation is not known.
    """
    faults, readings, imu_frame = Faults(), [], ""
    faults.are_skipped()
    for recorded in bag.messages([topic]):
        try:
            message = bag.deserialize(recorded)
            stamp = stamp_ns(message.header.stamp)
            if by_receipt or stamp == 0:
                stamp = recorded.stamp_ns
            readings.append(imu_reading(message, stamp, topic))
        except InputError as error:
            faults.add(error)
            continue
        imu_frame = imu_frame or frame_of(message.header)
    if not readings:
        return None
    T_camera_imu = _place(bag, color, imu_frame, inputs)
    if T_camera_imu is None:
        logger.warning(
            "%s: the bag does not contain the orientation of %s in the camera, so the IMU is "
            "ignored; give --set imu_pose='x y z roll pitch yaw', in the camera's optical frame",
            topic,
            imu_frame or "its frame, which has no name,",
        )
        return None
    return imu_samples(readings).rotated(T_camera_imu[:3, :3])


def _place(bag: BagFile, color: str, imu_frame: str, inputs: InputConfig) -> Float64 | None:
    """The pose [4, 4] of the IMU in the camera's optical frame; None if it is not known."""
    given = pose_parameter("imu_pose", inputs.imu_pose)
    if given is not None:
        return given
    try:
        camera_frame = frame_of(bag.first(color).header)
        if imu_frame and imu_frame == camera_frame:
            return np.eye(4)
        return recorded_transform(bag, camera_frame, imu_frame)
    except InputError:
        return None
