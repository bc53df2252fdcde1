"""Bags of the RealSense viewer: unit and place of its depth camera are read from its topics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from rigs.bags import Recorded, write_rosbag2
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages import making
from rgbd_glue_ros.messages.making import color_image
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings.bag.recording import BagRecording
from rgbd_glue_ros.types import CameraIntrinsics, Float32

STORE = get_typestore(Stores.ROS1_NOETIC)
STRING: Any = get_typestore(Stores.ROS2_JAZZY).types["std_msgs/msg/String"]
SENSOR = "/device_0/sensor_0"
COLOR, DEPTH = "/device_0/sensor_1/Color_0", f"{SENSOR}/Depth_0"
UNIT = f"{SENSOR}/option/Depth Units/value"
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


def write(
    path: Path,
    unit_m: float,
    left_out: str = "",
    reference: str = "tf/0",
    replaced: Mapping[str, Any] = MappingProxyType({}),
) -> Path:
    """Three frames of a wall, its depth camera beside that of colour."""
    units = np.zeros((48, 64), np.uint16)
    units[:, EDGE:] = round(WALL_M / unit_m)
    told = {
        f"{DEPTH}/info/camera_info": info(),
        f"{COLOR}/info/camera_info": info(),
        UNIT: message("std_msgs/msg/Float32", data=unit_m),
        f"{DEPTH}/{reference}": transform(0.0),
        f"{COLOR}/{reference}": transform(BASELINE_M),
        **replaced,
    }
    messages = [(topic, 1, content) for topic, content in told.items() if topic != left_out]
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


def assert_registered(depth: Float32) -> None:
    """The wall's edge is seen so many pixels to the right of where the depth camera has it."""
    shift = round(60 * BASELINE_M / WALL_M)
    assert np.nanmedian(depth) == pytest.approx(WALL_M, abs=1e-3)
    assert np.isnan(depth[24, EDGE + shift - 2])
    assert depth[24, EDGE + shift + 2] == pytest.approx(WALL_M, abs=1e-3)


@pytest.mark.parametrize("unit_m", [0.001, 0.00025, 0.000125])
def test_depth_is_registered_from_its_own_place_in_its_own_unit(
    unit_m: float, tmp_path: Path
) -> None:
    with BagRecording(write(tmp_path / "viewer.bag", unit_m)) as recording:
        frames = list(recording)
    assert len(frames) == 3
    assert_registered(frames[0].depth)
    assert frames[0].stamp_ns == 360 * 10**9


def test_a_given_unit_is_taken_in_place_of_the_bags(tmp_path: Path) -> None:
    path = write(tmp_path / "viewer.bag", 0.001)
    with BagRecording(path, inputs=InputConfig(depth_scale=0.0005)) as recording:
        assert np.nanmedian(next(iter(recording)).depth) == pytest.approx(WALL_M / 2, abs=1e-3)


@pytest.mark.parametrize("unit", [message("std_msgs/msg/String", data="fine"), transform(0.0)])
def test_a_unit_that_is_no_number_is_refused_unless_one_is_given(unit: Any, tmp_path: Path) -> None:
    path = write(tmp_path / "viewer.bag", 0.001, replaced={UNIT: unit})
    with pytest.raises(InputError, match=r"holds no valid unit of depth .*; give --depth-scale"):
        BagRecording(path)
    with BagRecording(path, inputs=InputConfig(depth_scale=0.001)) as recording:
        assert_registered(next(iter(recording)).depth)


@pytest.mark.parametrize(
    "place", [message("std_msgs/msg/String", data="fine"), message("std_msgs/msg/Float32", data=0)]
)
def test_a_place_that_is_no_transform_is_refused(place: Any, tmp_path: Path) -> None:
    path = write(tmp_path / "viewer.bag", 0.001, replaced={f"{COLOR}/tf/0": place})
    refused = pytest.raises(InputError, match="holds no valid transform")
    with BagRecording(path) as recording, refused:
        next(iter(recording))


def test_without_its_place_depth_is_refused_with_what_to_give(tmp_path: Path) -> None:
    path = write(tmp_path / "viewer.bag", 0.001, left_out=f"{COLOR}/tf/0")
    with (
        BagRecording(path) as recording,
        pytest.raises(InputError, match="the pose of the depth camera"),
    ):
        next(iter(recording))
    told = InputConfig(depth_camera_pose=f"{BASELINE_M} 0 0 0 0 0")
    with BagRecording(path, inputs=told) as recording:
        assert_registered(next(iter(recording)).depth)
    registered = InputConfig(depth_is_registered=True)
    with BagRecording(path, inputs=registered) as recording:
        assert np.isfinite(next(iter(recording)).depth[:, EDGE:]).all()


def test_without_its_camera_depth_is_taken_as_registered_and_that_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = write(tmp_path / "viewer.bag", 0.001, left_out=f"{DEPTH}/info/camera_info")
    with BagRecording(path) as recording:
        assert np.isfinite(next(iter(recording)).depth[:, EDGE:]).all()
    assert "if it is not, give --depth-calibration FILE" in caplog.text
    camera = CameraIntrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    with BagRecording(path, depth_calibration=camera) as recording:
        assert_registered(next(iter(recording)).depth)


def test_places_in_another_reference_than_the_first_are_read(tmp_path: Path) -> None:
    with BagRecording(write(tmp_path / "viewer.bag", 0.001, reference="tf/2")) as recording:
        assert_registered(next(iter(recording)).depth)


def test_bags_of_the_sdk_for_ros_2_tell_cameras_and_places_as_text(tmp_path: Path) -> None:
    """The rotation turns about the optical axis by a right angle, and is written by columns."""
    columns = "0,1,0,-1,0,0,0,0,1"
    text = "width=64;height=48;fx=60;ppx=31.5;fy=60;ppy=23.5;model=Brown Conrady;coeffs=0,0,0,0,0"
    told = {
        f"{DEPTH}/camera_info": text,
        f"{COLOR}/camera_info": text,
        f"{SENSOR}/option/Depth_Units/value": "0.000250",
        f"{DEPTH}/tf/ref_0": "rotation=1,0,0,0,1,0,0,0,1;translation=0,0,0",
        f"{COLOR}/tf/ref_0": f"rotation={columns};translation=0,0,0.5",
    }
    messages = [
        Recorded(topic, "std_msgs/msg/String", 1, STRING(data=content))
        for topic, content in told.items()
    ]
    units = np.zeros((48, 64), np.uint16)
    units[:, 32:] = round(WALL_M / 0.00025)
    stamp_ns = 360 * 10**9
    color = color_image(np.zeros((48, 64), np.uint8), making.header(stamp_ns, "Color"))
    depth = replace(
        color_image(np.zeros((48, 64), np.uint8), making.header(stamp_ns, "Depth")),
        encoding="mono16",
        step=128,
        data=units.view(np.uint8).ravel(),
    )
    for stream, image in ((COLOR, color), (DEPTH, depth)):
        messages.append(Recorded(f"{stream}/image/data", "sensor_msgs/msg/Image", 1000, image))
    with BagRecording(write_rosbag2(tmp_path / "bag", messages)) as recording:
        (frame,) = recording
    # x of the depth camera is y of the colour camera, which is half a metre behind
    assert np.isnan(frame.depth[:20]).all()
    assert frame.depth[40, 32] == pytest.approx(WALL_M + 0.5, abs=1e-3)
