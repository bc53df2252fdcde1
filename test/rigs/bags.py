"""Small frames, and bags of every kind made of them by rosbags alone."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from rgbd_glue_ros.messages.making import camera_info, header
from rgbd_glue_ros.recordings.bag.writer import COMPRESSED, RAW, ImageCodec
from rgbd_glue_ros.types import CameraIntrinsics, Float32, RgbdFrame, UInt8

CAMERA = CameraIntrinsics(64, 48, 60.0, 61.0, 31.5, 23.5)
START_NS, PERIOD_NS = 1_300_000_000_000_000_001, 33_333_333
COLOR, DEPTH, INFO = "/camera/rgb/image", "/camera/depth/image", "/camera/rgb/camera_info"
CODECS = {"raw": RAW, "compressed": COMPRESSED}


@dataclass(frozen=True)
class Recorded:
    """A message to be recorded."""

    topic: str
    type: str
    stamp_ns: int
    message: Any


def make_frames(count: int) -> list[RgbdFrame]:
    return [_frame(i) for i in range(count)]


def _frame(i: int) -> RgbdFrame:
    random = np.random.default_rng(i)
    noise = random.integers(0, 256, (48, 64, 3), dtype=np.uint8)
    color: UInt8 = np.asarray(cv2.GaussianBlur(noise, (0, 0), 5), np.uint8)
    millimetres = random.integers(500, 5000, (48, 64))
    depth: Float32 = np.divide(millimetres, np.float32(1000), dtype=np.float32)
    depth[:5] = np.nan
    return RgbdFrame(START_NS + i * PERIOD_NS, color, depth, CAMERA, "camera_optical")


def assert_same_frame(frame: RgbdFrame, original: RgbdFrame, codec: ImageCodec = RAW) -> None:
    """Equal but for what JPEG costs."""
    assert frame.stamp_ns == original.stamp_ns
    assert frame.frame_id == original.frame_id
    assert frame.intrinsics == original.intrinsics
    assert np.array_equal(frame.depth, original.depth, equal_nan=True)
    error = np.abs(frame.color.astype(int) - original.color)
    assert error.mean() <= (0 if codec is RAW else 3)


def recorded(frames: Iterable[RgbdFrame], codec: ImageCodec = RAW) -> list[Recorded]:
    """The three messages of each frame."""
    messages = []
    for frame in frames:
        head = header(frame.stamp_ns, frame.frame_id)
        color, depth = codec.color(frame.color, head), codec.depth(frame.depth, head)
        info = camera_info(frame.intrinsics, head)
        messages += [
            Recorded(COLOR + codec.color_suffix, codec.type, frame.stamp_ns, color),
            Recorded(DEPTH + codec.depth_suffix, codec.type, frame.stamp_ns, depth),
            Recorded(INFO, "sensor_msgs/msg/CameraInfo", frame.stamp_ns, info),
        ]
    return messages


def write_rosbag2(
    folder: Path,
    messages: Iterable[Recorded],
    storage: StoragePlugin = StoragePlugin.MCAP,
    compression: CompressionMode = CompressionMode.NONE,
) -> Path:
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(folder, version=9, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for m in messages:
            if m.topic not in connections:
                connections[m.topic] = writer.add_connection(m.topic, m.type, typestore=store)
            writer.write(connections[m.topic], m.stamp_ns, store.serialize_cdr(m.message, m.type))
    return folder


def write_rosbag1(file: Path, messages: Iterable[Recorded], compression: str = "") -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Rosbag1Writer(file)
    # small chunks, so that a file cut off in the middle has whole ones
    writer.chunk_threshold = 2**16
    if compression:
        writer.set_compression(Rosbag1Writer.CompressionFormat[compression])
    with writer:
        connections: dict[str, Any] = {}
        for number, m in enumerate(messages):
            if m.topic not in connections:
                connections[m.topic] = writer.add_connection(m.topic, m.type, typestore=store)
            data = store.serialize_ros1(_ros1(m.message, store, number), m.type)
            writer.write(connections[m.topic], m.stamp_ns, data)
    return file


def _ros1(message: Any, store: Any, number: int) -> Any:
    """ROS 1 numbers its headers, and writes the matrices of a camera info in capitals."""
    values = dict(vars(message))
    if "k" in values:
        values |= {name.upper(): values.pop(name) for name in "dkrp"}
    head = store.types["std_msgs/msg/Header"]
    values["header"] = head(number, message.header.stamp, message.header.frame_id)
    kind = type(message).__name__
    package = "geometry_msgs" if kind == "PoseStamped" else "sensor_msgs"
    return store.types[f"{package}/msg/{kind}"](**values)
