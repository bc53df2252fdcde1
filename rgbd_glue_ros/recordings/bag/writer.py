"""Writes frames, true poses and samples of an IMU to a rosbag2 in MCAP."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from rosbags.typesys import Stores, get_typestore

from rgbd_glue_ros.closing import Closing, uninterrupted
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fields import CompressedImage, Header, Image
from rgbd_glue_ros.messages.images import COLOR_SUFFIX, DEPTH_SUFFIX
from rgbd_glue_ros.messages.making import (
    camera_info,
    check_recordable,
    color_image,
    compressed_color_image,
    compressed_depth_image,
    depth_image,
    header,
    imu,
    pose_stamped,
)
from rgbd_glue_ros.types import Float32, Float64, ImuSamples, RgbdFrame, UInt8

GROUND_TRUTH_TOPIC = "/ground_truth/pose"
"""Topic of ground-truth poses in bags written here."""

CAMERA_FRAME = "camera_color_optical_frame"
WORLD_FRAME = "world"


@dataclass(frozen=True)
class WrittenTopics:
    """Topics of a bag that is written, without the suffixes of a codec.

    Attributes:
        color: of the colour images.
        depth: of the depth images, registered to colour.
        info: of the camera infos of colour.
        imu: of the IMU.
    """

    color: str = "/camera/color/image_raw"
    depth: str = "/camera/aligned_depth_to_color/image_raw"
    info: str = "/camera/color/camera_info"
    imu: str = "/camera/imu"


AS_REALSENSE = WrittenTopics()
"""The names used by a RealSense camera's driver."""


@dataclass(frozen=True)
class ImageCodec:
    """How images are put into messages.

    Attributes:
        type: of the messages.
        color_suffix: of the colour images' topic.
        depth_suffix: of the depth images' topic.
        color: creates the message of a colour image, [H, W, 3] RGB or [H, W].
        depth: creates the message of a depth image, [H, W] metres.
    """

    type: str
    color_suffix: str
    depth_suffix: str
    color: Callable[[UInt8, Header], Image | CompressedImage]
    depth: Callable[[Float32, Header], Image | CompressedImage]


RAW = ImageCodec(
    "sensor_msgs/msg/Image",
    "",
    "",
    color_image,
    depth_image,
)
"""rgb8 or mono8, and 32FC1: lossless."""

COMPRESSED = ImageCodec(
    "sensor_msgs/msg/CompressedImage",
    COLOR_SUFFIX,
    DEPTH_SUFFIX,
    compressed_color_image,
    compressed_depth_image,
)
"""JPEG, and PNG of whole millimetres, as in image_transport."""

INFO_TYPE = "sensor_msgs/msg/CameraInfo"
IMU_TYPE = "sensor_msgs/msg/Imu"
_POSE_TYPE = "geometry_msgs/msg/PoseStamped"

_TYPES = get_typestore(Stores.ROS2_JAZZY)

_NO_LIMIT = QosTime(0, 0)


def _qos(depth: int) -> Qos:
    # Most subscribers of images request best effort, some reliable: a reliable publisher serves
    # both, so that a player with the offered profiles reaches all.
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=depth,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.VOLATILE,
        deadline=_NO_LIMIT,
        lifespan=_NO_LIMIT,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_NO_LIMIT,
        avoid_ros_namespace_conventions=False,
    )


# Below 10, even reliable transport was seen to lose camera infos.
_IMAGE_QOS = _qos(depth=10)
_POSE_QOS = _qos(depth=100)
_IMU_QOS = _qos(depth=100)


@dataclass(frozen=True)
class FrameMessages:
    """The serialised messages of a frame."""

    stamp_ns: int
    color: memoryview
    depth: memoryview
    info: memoryview


def encode_frame(frame: RgbdFrame, codec: ImageCodec) -> FrameMessages:
    """Serialises a frame's messages; any thread may call it.

    Args:
        frame: the frame.
        codec: ``RAW`` or ``COMPRESSED``.

    Raises:
        InputError: its time cannot be stored in a bag.
    """
    for stamp_ns in (frame.stamp_ns, frame.stamp_ns + frame.depth_delay_ns):
        check_recordable(stamp_ns)
    head = header(frame.stamp_ns, frame.frame_id or CAMERA_FRAME)
    depth_head = header(frame.stamp_ns + frame.depth_delay_ns, head.frame_id)
    serialize = _TYPES.serialize_cdr
    return FrameMessages(
        frame.stamp_ns,
        serialize(codec.color(frame.color, head), codec.type),
        serialize(codec.depth(frame.depth, depth_head), codec.type),
        serialize(camera_info(frame.intrinsics, head), INFO_TYPE),
    )


def encode_imu(samples: ImuSamples, index: int, frame_id: str) -> memoryview:
    """Serialises one sample, in the axes of a frame; raises InputError if its time does not fit."""
    check_recordable(int(samples.stamps_ns[index]))
    return _TYPES.serialize_cdr(imu(samples, index, frame_id or CAMERA_FRAME), IMU_TYPE)


class BagWriter(Closing):
    """A bag under construction; as a context manager, it always leaves a valid bag.

    Equal calls write equal bytes.
    """

    def __init__(
        self, folder: Path, codec: ImageCodec, topics: WrittenTopics = AS_REALSENSE
    ) -> None:
        """Creates the bag.

        Args:
            folder: of the bag; must not exist.
            codec: ``RAW`` or ``COMPRESSED``.
            topics: names of its topics.

        Raises:
            InputError: the folder exists or cannot be written.
        """
        self._codec = codec
        self._pose: Connection | None = None
        self._imu: Connection | None = None
        self._imu_topic = topics.imu
        try:
            self._writer = Writer(
                folder, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP
            )
            self._writer.open()
        except (WriterError, OSError) as error:
            raise InputError(folder, f"cannot be written ({error})", "give a new folder") from error
        self._color = self._topic(topics.color + codec.color_suffix, codec.type, _IMAGE_QOS)
        self._depth = self._topic(topics.depth + codec.depth_suffix, codec.type, _IMAGE_QOS)
        self._info = self._topic(topics.info, INFO_TYPE, _IMAGE_QOS)

    def encode(self, frame: RgbdFrame) -> FrameMessages:
        """Does the slow part of writing a frame; any thread may call it."""
        return encode_frame(frame, self._codec)

    def write(self, frame: FrameMessages) -> None:
        """Adds colour, depth and camera info; frames and poses come in order of time."""
        self._writer.write(self._info, frame.stamp_ns, frame.info)
        self._writer.write(self._color, frame.stamp_ns, frame.color)
        self._writer.write(self._depth, frame.stamp_ns, frame.depth)

    def write_pose(self, stamp_ns: int, T_world_camera: Float64) -> None:
        """Adds a true pose [4, 4] of the optical frame; raises InputError for a bad time."""
        check_recordable(stamp_ns)
        if self._pose is None:
            self._pose = self._topic(GROUND_TRUTH_TOPIC, _POSE_TYPE, _POSE_QOS)
        pose = pose_stamped(T_world_camera, header(stamp_ns, WORLD_FRAME))
        self._writer.write(self._pose, stamp_ns, _TYPES.serialize_cdr(pose, _POSE_TYPE))

    def write_imu(self, samples: ImuSamples, index: int, frame_id: str) -> None:
        """Adds one sample, in the axes of a frame; raises InputError for a bad time."""
        encoded = encode_imu(samples, index, frame_id)
        if self._imu is None:
            self._imu = self._topic(self._imu_topic, IMU_TYPE, _IMU_QOS)
        self._writer.write(self._imu, int(samples.stamps_ns[index]), encoded)

    @uninterrupted()
    def close(self) -> None:
        """Writes index and metadata."""
        self._writer.close()

    def _topic(self, name: str, message_type: str, qos: Qos) -> Connection:
        return self._writer.add_connection(
            name, message_type, typestore=_TYPES, offered_qos_profiles=[qos]
        )
