"""Bags of the RealSense viewer: unit and place of its depth camera are read from its topics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings.bag.recording import BagRecording

STORE = get_typestore(Stores.ROS1_NOETIC)
SENSOR = "/device_0/sensor_0"
COLOR, DEPTH = "/device_0/sensor_1/Color_0", f"{SENSOR}/Depth_0"
BASELINE_M, WALL_M = 0.1, 2.0
EDGE = 20
"""Column of the depth image from which on the wall is; before it, nothing is known."""


def message(kind: str, **fields: Any) -> Any:
    return STORE.types[kind](**fields)


def header(stamp_ns: int) -> Any:
    time = message("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return message("std_msgs/msg/Header", seq=0, stamp=time, frame_id="0")


def image(stamp_ns: int, encoding: str, pixels: Any) -> Any:
    return message(
        "sensor_msgs/msg/Image",
        header=header(stamp_ns),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=pixels.strides[0],
        data=pixels.view(np.uint8).ravel(),
    )


def info() -> Any:
    region = message(
        "sensor_msgs/msg/RegionOfInterest",
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False,
    )  # fmt: skip
    return message(
        "sensor_msgs/msg/CameraInfo",
        header=header(0),
        height=48,
        width=64,
        distortion_model="Brown Conrady",
        D=np.zeros(5),
        K=np.array([60.0, 0, 31.5, 0, 60, 23.5, 0, 0, 1]),
        R=np.zeros(9),
        P=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=region,
    )


def transform(x: float) -> Any:
    return message(
        "geometry_msgs/msg/Transform",
        translation=message("geometry_msgs/msg/Vector3", x=x, y=0.0, z=0.0),
        rotation=message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
    )


def write(path: Path, unit_m: float, left_out: str = "") -> Path:
    """Three frames of a wall, its depth camera beside that of colour."""
    units = np.zeros((48, 64), np.uint16)
    units[:, EDGE:] = round(WALL_M / unit_m)
    float32 = message("std_msgs/msg/Float32", data=unit_m)
    told = [
        (f"{DEPTH}/info/camera_info", info()),
        (f"{COLOR}/info/camera_info", info()),
        (f"{SENSOR}/option/Depth Units/value", float32),
        (f"{DEPTH}/tf/0", transform(0.0)),
        (f"{COLOR}/tf/0", transform(BASELINE_M)),
    ]
    messages = [(topic, 1, content) for topic, content in told if topic != left_out]
    for i in range(3):
        stamp_ns = 360 * 10**9 + i * 33_333_333
        color = image(stamp_ns, "rgb8", np.full((48, 64, 3), 9, np.uint8))
        depth = image(stamp_ns + 2_000_000, "mono16", units)
        messages += [
            (f"{COLOR}/image/data", 1000 + i, color),
            (f"{DEPTH}/image/data", 1000 + i, depth),
        ]
    with Writer(path) as bag:
        connections: dict[str, Any] = {}
        for topic, stamp_ns, content in messages:
            kind = content.__msgtype__
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=STORE)
            bag.write(connections[topic], stamp_ns, STORE.serialize_ros1(content, kind))
    return path


@pytest.mark.parametrize("unit_m", [0.001, 0.00025, 0.000125])
def test_depth_is_registered_from_its_own_place_in_its_own_unit(
    unit_m: float, tmp_path: Path
) -> None:
    with BagRecording(write(tmp_path / "viewer.bag", unit_m)) as recording:
        frames = list(recording)
    assert len(frames) == 3
    depth = frames[0].depth
    # the wall's edge is seen so many pixels to the right of where the depth camera has it
    shift = round(60 * BASELINE_M / WALL_M)
    assert np.nanmedian(depth) == pytest.approx(WALL_M, abs=1e-3)
    assert np.isnan(depth[24, EDGE + shift - 2])
    assert depth[24, EDGE + shift + 2] == pytest.approx(WALL_M, abs=1e-3)
    assert frames[0].stamp_ns == 360 * 10**9


def test_a_given_unit_is_taken_in_place_of_the_bags(tmp_path: Path) -> None:
    path = write(tmp_path / "viewer.bag", 0.001)
    with BagRecording(path, inputs=InputConfig(depth_scale=0.0005)) as recording:
        assert np.nanmedian(next(iter(recording)).depth) == pytest.approx(WALL_M / 2, abs=1e-3)


def test_without_its_place_depth_is_refused_rather_than_taken_for_registered(
    tmp_path: Path,
) -> None:
    path = write(tmp_path / "viewer.bag", 0.001, left_out=f"{COLOR}/tf/0")
    with BagRecording(path) as recording, pytest.raises(InputError, match="where the depth camera"):
        next(iter(recording))
