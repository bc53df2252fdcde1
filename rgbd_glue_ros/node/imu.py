"""The node's IMU input."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.messages.imu import imu_reading, imu_samples
from rgbd_glue_ros.messages.imu_queue import ImuQueue
from rgbd_glue_ros.messages.poses import pose_parameter
from rgbd_glue_ros.messages.reading import frame_of, stamp_ns
from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.node.tf import Transforms
from rgbd_glue_ros.parameters import NodeConfig
from rgbd_glue_ros.types import NANOSECONDS, Float64, ImuSamples

# Messages kept until the next frame, or until TF has the sensor's orientation: 10 s at 200 Hz.
_MOST_WAITING = 2000
# How long the first frame waits for samples up to its stamp, if there is a publisher: odom needs
# them to start level.
_FIRST_WAIT_S = 1.0
# Samples cover a frame if the last one is at most this much earlier.
_REACH_NS = NANOSECONDS // 20


class ImuInput:
    """Subscribes to an IMU, which need not exist.

    Attributes:
        topic: full name of the IMU topic.
    """

    def __init__(
        self,
        node: BaseNode,
        config: NodeConfig,
        transforms: Transforms | None,
        is_by_receipt: Callable[[], bool],
    ) -> None:
        """Subscribes.

        Args:
            node: subscribes, and provides the log.
            config: may give the IMU's orientation in the camera.
            transforms: where to look it up; None without TF.
            is_by_receipt: whether images are stamped with the time of receipt: both must be of one
                clock.

        Raises:
            InputError: ``imu_pose`` cannot be read.
        """
        self.topic = str(node.resolve_topic_name(topics.IMU))
        self._node = node
        self._transforms = transforms
        self._given_pose = pose_parameter("imu_pose", config.imu_pose)
        self._known_poses: dict[tuple[str, str], Float64] = {}
        self._readings = ImuQueue(_MOST_WAITING, is_by_receipt)
        self._imu_frame = ""
        self._changed = threading.Condition()
        self._has_waited = False
        self._is_used = False
        # best effort matches every publisher, and a few of so many samples may be lost
        qos = QoSProfile(depth=_MOST_WAITING, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._subscription = node.create_subscription(Imu, self.topic, self._receive, qos)

    def _receive(self, message: Imu) -> None:
        receipt_ns = self._node.get_clock().now().nanoseconds
        try:
            reading = imu_reading(message, stamp_ns(message.header.stamp), self.topic)
        except InputError as fault:
            self._node.warn_once(fault.where, f"{fault.cause}; {fault.remedy}")
            return
        with self._changed:
            self._imu_frame = frame_of(message.header)
            self._readings.add(reading, receipt_ns)
            self._changed.notify_all()

    def take(self, camera_frame: str, stamp_ns: int) -> ImuSamples:
        """Returns the samples since the last call, in the axes of the camera's optical frame.

        They are empty until the sensor's orientation in that frame is known. The first call waits
        up to a second for samples up to the frame's stamp; later calls do not wait.

        Args:
            camera_frame: the optical frame of the camera.
            stamp_ns: stamp of the frame, nanoseconds.
        """
        if not self._has_waited and self._node.count_publishers(self.topic) > 0:
            with self._changed:
                self._changed.wait_for(lambda: self._reaches(stamp_ns), _FIRST_WAIT_S)
            self._has_waited = True
        if not len(self._readings):
            return ImuSamples.empty()
        T_camera_imu = self._pose_in(camera_frame)
        if T_camera_imu is None:
            return ImuSamples.empty()
        with self._changed:
            readings = self._readings.take()
        return imu_samples(readings).rotated(T_camera_imu[:3, :3])

    def _reaches(self, stamp_ns: int) -> bool:
        newest = self._readings.newest_ns
        return newest is not None and newest >= stamp_ns - _REACH_NS

    def _pose_in(self, camera_frame: str) -> Float64 | None:
        """The IMU's pose [4, 4] in the camera's optical frame; None if it is unknown."""
        imu_frame = self._imu_frame
        T_camera_imu = self._given_pose
        if T_camera_imu is None and imu_frame and imu_frame == camera_frame:
            T_camera_imu = np.eye(4)
        if T_camera_imu is None:
            T_camera_imu = self._look_up(camera_frame, imu_frame)
        if T_camera_imu is None:
            self._node.warn_once(
                self.topic,
                f"TF has no transform from {imu_frame or 'the IMU, whose frame has no name,'} to "
                f"{camera_frame}, so the IMU is not used yet; publish it, or set imu_pose",
            )
            return None
        if not self._is_used:
            self._is_used = True
            self._node.get_logger().info(f"Using the IMU on {self.topic}")
        return T_camera_imu

    def _look_up(self, camera_frame: str, imu_frame: str) -> Float64 | None:
        """The IMU's pose [4, 4] in the camera, from the first successful look-up on TF."""
        T_camera_imu = self._known_poses.get((camera_frame, imu_frame))
        if T_camera_imu is None and self._transforms is not None:
            T_camera_imu = self._transforms.lookup(camera_frame, imu_frame, None, 0.0)
            if T_camera_imu is not None:
                self._known_poses[camera_frame, imu_frame] = T_camera_imu
        return T_camera_imu
