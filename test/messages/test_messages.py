from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages import fields
from rgbd_glue_ros.messages.camera_info import intrinsics_from_message
from rgbd_glue_ros.messages.fields import (
    CameraInfo,
    CompressedImage,
    Header,
    Image,
    RegionOfInterest,
    Time,
    camera_info,
    color_image,
    compressed_color_image,
    compressed_depth_image,
    depth_image,
    header,
    pose_stamped,
)
from rgbd_glue_ros.messages.frame import (
    FrameTopics,
    frame_from_messages,
    registration_doubt,
    resampled,
)
from rgbd_glue_ros.messages.image_codecs import encode_png
from rgbd_glue_ros.messages.images import color_from_message, depth_from_message
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.types import CameraIntrinsics

HEAD = header(1_234_567_890_123_456_789, "camera_optical")
TOPICS = FrameTopics("/color", "/depth", "/info")
CAMERA = CameraIntrinsics(64, 48, 60.0, 61.0, 31.5, 23.5, (0.1, -0.2, 0.001, 0.002, 0.3))
RGB = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
DEPTH = np.random.default_rng(1).uniform(0.3, 9.0, (48, 64)).astype(np.float32)


def raw(
    pixels: NDArray[Any], encoding: str, *, is_bigendian: bool = False, padding: int = 0
) -> Image:
    """An Image message with rows padded by some bytes."""
    dtype = pixels.dtype.newbyteorder(">" if is_bigendian else "<")
    swapped = np.ascontiguousarray(pixels.astype(dtype))
    rows = swapped.view(np.uint8).reshape(len(pixels), -1)
    padded = np.pad(rows, [(0, 0), (0, padding)], constant_values=0xAB)
    height, width = pixels.shape[:2]
    return Image(
        HEAD, height, width, encoding, int(is_bigendian), padded.shape[1], padded.reshape(-1)
    )


def smooth(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Something that JPEG can hold."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 4), np.uint8)


@pytest.mark.parametrize("padding", [0, 3, 64])
@pytest.mark.parametrize(
    ("encoding", "channels"),
    [
        ("rgb8", "rgb"),
        ("bgr8", "bgr"),
        ("rgba8", "rgba"),
        ("bgra8", "bgra"),
        ("8UC3", "bgr"),
        ("8UC4", "bgra"),
    ],
)
def test_every_colour_encoding_gives_the_same_rgb(
    encoding: str, channels: str, padding: int
) -> None:
    alpha = np.full((48, 64, 1), 77, np.uint8)
    pixels = np.concatenate([RGB, alpha], axis=2)[..., ["rgba".index(c) for c in channels]]
    image = color_from_message(raw(pixels, encoding, padding=padding), "/color")
    assert np.array_equal(image, RGB)
    assert image.flags.c_contiguous


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("encoding", ["mono8", "8UC1"])
def test_grey_stays_grey(encoding: str, padding: int) -> None:
    image = color_from_message(raw(RGB[..., 0], encoding, padding=padding), "/color")
    assert np.array_equal(image, RGB[..., 0])


def test_rgb_without_padding_is_not_copied() -> None:
    message = raw(RGB, "rgb8")
    assert np.shares_memory(color_from_message(message, "/color"), message.data)


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("padding", [0, 1, 6])
@given(units=npst.arrays(np.uint16, (3, 5)))
@settings(max_examples=20, deadline=None)
def test_sixteen_bit_depth_is_in_millimetres_with_0_and_overflow_for_unknown(
    units: NDArray[np.uint16], padding: int, is_bigendian: bool
) -> None:
    for encoding in ("16UC1", "mono16"):
        message = raw(units, encoding, is_bigendian=is_bigendian, padding=padding)
        depth = depth_from_message(message, "/depth")
        assert depth.dtype == np.float32
        is_known = (units > 0) & (units < 65535)
        expected = np.where(is_known, units / 1000, np.nan).astype(np.float32)
        assert np.array_equal(depth, expected, equal_nan=True)


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("padding", [0, 2])
def test_float_depth_is_in_metres_and_what_is_no_depth_becomes_nan(
    padding: int, is_bigendian: bool
) -> None:
    values = np.array([[1.5, 0.0, -1.0], [np.nan, np.inf, -np.inf]], np.float32)
    message = raw(values, "32FC1", is_bigendian=is_bigendian, padding=padding)
    nan = np.nan
    expected = [[1.5, nan, nan], [nan, nan, nan]]
    assert np.array_equal(depth_from_message(message, "/depth"), expected, equal_nan=True)


def test_a_truncated_image_is_refused_with_its_topic_and_size() -> None:
    message = raw(RGB, "rgb8")
    with pytest.raises(InputError) as caught:
        color_from_message(replace(message, data=message.data[:-1]), "/camera/color")
    assert str(caught.value) == (
        "/camera/color: data are cut off: 9215 bytes instead of 9216 for 64x48 rgb8; "
        "check the publisher or the recording"
    )


def test_the_padding_of_the_last_row_may_be_missing() -> None:
    message = raw(RGB, "rgb8", padding=64)
    message = replace(message, data=message.data[:-64])
    assert np.array_equal(color_from_message(message, "/color"), RGB)


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"encoding": "h264"}, "encoding 'h264' is none of colour"),
        ({"encoding": "16UC1"}, "encoding '16UC1' is none of colour"),
        ({"step": 0}, "step is 0 bytes, but a row of 64 pixels rgb8 has 192"),
        ({"width": 0}, "an image of 0x48 pixels"),
        ({"width": 2**31, "height": 2**31}, "pixels"),
    ],
)
def test_an_image_whose_fields_make_no_sense_is_refused(
    changes: dict[str, Any], cause: str
) -> None:
    with pytest.raises(InputError, match=r"^/color: ") as caught:
        color_from_message(replace(raw(RGB, "rgb8"), **changes), "/color")
    assert cause in str(caught.value)


def test_colour_on_the_depth_topic_is_refused() -> None:
    with pytest.raises(InputError, match="encoding 'rgb8' is none of depth"):
        depth_from_message(raw(RGB, "rgb8"), "/depth")
    with pytest.raises(InputError, match="holds no depth"):
        depth_from_message(compressed_color_image(RGB, HEAD), "/depth")


def test_a_message_of_another_type_is_refused() -> None:
    info: Any = camera_info(CAMERA, HEAD)
    with pytest.raises(InputError, match="is of type CameraInfo; give a topic of Image or Com"):
        color_from_message(info, "/color")
    with pytest.raises(InputError, match="is of type Image; give a topic of CameraInfo"):
        intrinsics_from_message(raw(RGB, "rgb8"), "/info")  # type: ignore[arg-type]


def test_jpeg_colours_are_in_the_right_order() -> None:
    image = smooth(RGB)
    decoded = color_from_message(compressed_color_image(image, HEAD, 98), "/color")
    assert np.abs(decoded.astype(int) - image).max() < 12
    grey = color_from_message(compressed_color_image(image[..., 0], HEAD, 98), "/color")
    assert grey.shape == (48, 64)
    assert np.abs(grey.astype(int) - image[..., 0]).max() < 12


@pytest.mark.parametrize(
    ("text", "in_file"),
    [
        ("png", "bgr"),
        ("bgr8; png compressed bgr8", "bgr"),
        ("rgb8; png compressed bgr8", "bgr"),
        ("rgb8; png compressed rgb8", "rgb"),
    ],
)
def test_the_order_of_colours_follows_the_format_text(text: str, in_file: str) -> None:
    pixels = RGB[..., ["rgb".index(c) for c in in_file]]
    message = CompressedImage(HEAD, text, np.frombuffer(encode_png(pixels), np.uint8))
    assert np.array_equal(color_from_message(message, "/color"), RGB)


def test_png_with_alpha_loses_it() -> None:
    pixels = np.concatenate([RGB[..., ::-1], np.full((48, 64, 1), 9, np.uint8)], axis=2)
    message = CompressedImage(HEAD, "png", np.frombuffer(encode_png(pixels), np.uint8))
    assert np.array_equal(color_from_message(message, "/color"), RGB)


def test_compressed_depth_is_exact_to_half_a_millimetre() -> None:
    depth = DEPTH.copy()
    depth[0, :3] = np.nan, 70.0, np.inf
    decoded = depth_from_message(compressed_depth_image(depth, HEAD), "/depth")
    assert np.isnan(decoded[0, :3]).all()
    assert np.nanmax(np.abs(decoded - depth)[1:]) <= 0.0005 + 1e-6


def test_depth_as_plain_compressed_png_is_read_too() -> None:
    units = np.rint(DEPTH * 1000).astype(np.uint16)
    message = CompressedImage(HEAD, "16UC1; png compressed ", _flat(encode_png(units)))
    assert np.allclose(depth_from_message(message, "/depth"), units / 1000)


def test_quantised_float_depth_follows_its_formula() -> None:
    """As compressed_depth_image_transport writes it: v = A / z + B."""
    a, b = 100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0
    units = np.where(DEPTH > 0.5, a / DEPTH + b, 0).astype(np.uint16)
    data = struct.pack("<iff", 0, a, b) + encode_png(units)
    depth = depth_from_message(
        CompressedImage(HEAD, "32FC1; compressedDepth png", _flat(data)), "/depth"
    )
    assert np.array_equal(np.isnan(depth), units == 0)
    assert np.nanmax(np.abs(depth - DEPTH) / DEPTH**2) < 1 / a + 1e-6


def test_depth_as_rvl_is_read_in_millimetres_and_as_quantised_floats() -> None:
    # 3 zeros, 3 others: 1000, then 1 more, then 2 less
    data = struct.pack("<iffIII", 0, 10.0, -1.0, 3, 2, 0x338AF323)
    nan = np.nan
    for text, expected in (
        ("16UC1; compressedDepth rvl", [[nan, nan, nan], [1.0, 1.001, 0.999]]),
        ("32FC1; compressedDepth rvl", [[nan, nan, nan], [10 / 1001, 10 / 1002, 10 / 1000]]),
    ):
        depth = depth_from_message(CompressedImage(HEAD, text, _flat(data)), "/depth")
        np.testing.assert_allclose(depth, expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "data", "cause"),
    [
        ("16UC1; compressedDepth rvl", bytes(12), "cut off"),
        ("16UC1; compressedDepth png", b"1234", "cut off"),
        ("16UC1; compressedDepth png", bytes(12), "neither PNG nor JPEG"),
        ("16UC1; compressedDepth png", bytes(12) + encode_png(RGB), "uint8 and shape"),
        (
            "32FC1; compressedDepth png",
            bytes(12) + encode_png(np.ones((4, 4), np.uint16)),
            r"quantisation \(0.0, 0.0\) makes no sense",
        ),
    ],
)
def test_compressed_depth_that_cannot_be_read_is_refused(
    text: str, data: bytes, cause: str
) -> None:
    with pytest.raises(InputError, match=f"^/depth: .*{cause}"):
        depth_from_message(CompressedImage(HEAD, text, _flat(data)), "/depth")


def test_compressed_depth_on_the_colour_topic_is_refused() -> None:
    with pytest.raises(InputError, match="is depth"):
        color_from_message(compressed_depth_image(DEPTH, HEAD), "/color")


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_stamps_keep_every_nanosecond(nanoseconds: int) -> None:
    assert stamp_ns(header(nanoseconds, "").stamp) == nanoseconds


def test_the_camera_comes_back_from_its_info() -> None:
    rational = replace(CAMERA, distortion=tuple(0.01 * i for i in range(1, 9)))
    for camera in (CAMERA, rational, replace(CAMERA, distortion=())):
        assert intrinsics_from_message(camera_info(camera, HEAD), "/info") == camera


def test_cropping_shifts_and_binning_scales_the_camera() -> None:
    """A 3D point's pixel, cropped and binned by hand, is where the camera says it is."""
    info = replace(
        camera_info(CAMERA, HEAD),
        roi=RegionOfInterest(x_offset=8, y_offset=4, width=40, height=20),
        binning_x=2,
        binning_y=4,
    )
    camera = intrinsics_from_message(info, "/info")
    assert (camera.width, camera.height) == (20, 5)
    x, y, z = 0.2, -0.1, 2.0
    u, v = CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy
    # the first bin spans pixels 8 to 9, so its centre is at 8.5
    assert camera.fx * x / z + camera.cx == pytest.approx((u - 8.5) / 2)
    assert camera.fy * y / z + camera.cy == pytest.approx((v - 5.5) / 4)


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"k": np.zeros(9)}, "K is all zeros: the camera is not calibrated"),
        ({"k": np.full(9, np.nan)}, "K is no camera matrix"),
        ({"k": np.array([60, 0, np.inf, 0, 60, 23, 0, 0, 1])}, "K is no camera matrix"),
        ({"k": np.array([-60.0, 0, 31, 0, 60, 23, 0, 0, 1])}, "K is no camera matrix"),
        ({"d": np.array([np.nan] * 5)}, "D holds"),
        ({"distortion_model": "equidistant"}, "distortion model 'equidistant' are not supported"),
        ({"width": 0}, "an image of 0x48 pixels"),
        ({"roi": RegionOfInterest(30, 0, 40, 48)}, "is not within 64x48"),
        ({"binning_x": 65}, "an image of 0x48 pixels"),
    ],
)
def test_a_camera_info_that_makes_no_sense_is_refused(changes: dict[str, Any], cause: str) -> None:
    info: CameraInfo = replace(camera_info(CAMERA, HEAD), **changes)
    with pytest.raises(InputError, match=r"^/info: ") as caught:
        intrinsics_from_message(info, "/info")
    assert cause in str(caught.value)


def test_of_a_rectified_image_p_is_the_camera_and_distortion_is_gone() -> None:
    info = camera_info(CAMERA, HEAD)
    p = np.array([50.0, 0, 30, 0, 0, 50, 20, 0, 0, 0, 1, 0])
    color, depth = color_image(RGB, HEAD), depth_image(DEPTH, HEAD)
    for name in ("/camera/rgb/image_rect_color", "/left/image_rect/compressed"):
        topics = replace(TOPICS, color=name)
        frame = frame_from_messages(color, depth, replace(info, p=p), topics)
        assert frame.intrinsics == CameraIntrinsics(64, 48, 50.0, 50.0, 30.0, 20.0)
        without_p = frame_from_messages(color, depth, replace(info, p=np.zeros(12)), topics)
        assert without_p.intrinsics == replace(CAMERA, distortion=())
    raw_topics = replace(TOPICS, color="/camera_rect/image_direct")
    frame = frame_from_messages(color, depth, replace(info, p=p), raw_topics)
    assert frame.intrinsics == CAMERA


def test_depth_in_another_frame_than_colour_is_doubted() -> None:
    color = color_image(RGB, HEAD)
    elsewhere = depth_image(DEPTH, replace(HEAD, frame_id="depth_optical"))
    doubt = registration_doubt(color, elsewhere, TOPICS)
    assert doubt is not None
    assert "/depth: its frame is depth_optical, but that of /color is camera_optical" in doubt
    for frame_id in ("", HEAD.frame_id):
        depth = depth_image(DEPTH, replace(HEAD, frame_id=frame_id))
        assert registration_doubt(color, depth, TOPICS) is None


def test_an_unknown_model_without_distortion_is_no_matter() -> None:
    info = replace(camera_info(CAMERA, HEAD), distortion_model="", d=np.zeros(0))
    assert intrinsics_from_message(info, "/info").distortion == ()


def test_a_frame_has_the_stamp_and_frame_of_its_colour_image() -> None:
    later = Header(Time(2_000_000_000, 5), "depth_optical")
    frame = frame_from_messages(
        color_image(RGB, HEAD), depth_image(DEPTH, later), camera_info(CAMERA, later), TOPICS
    )
    assert frame.stamp_ns == 1_234_567_890_123_456_789
    assert frame.frame_id == "camera_optical"
    assert np.array_equal(frame.color, RGB)
    assert np.array_equal(frame.depth, DEPTH)
    assert frame.intrinsics == CAMERA


@pytest.mark.parametrize(("width", "height"), [(32, 24), (128, 96), (96, 72), (64, 48)])
def test_depth_of_another_size_is_resampled_as_opencv_does_about_pixel_centres(
    width: int, height: int
) -> None:
    expected = cv2.resize(DEPTH, (width, height), interpolation=cv2.INTER_NEAREST_EXACT)
    assert np.array_equal(resampled(DEPTH, width, height), expected)


def test_a_plane_stays_a_plane_when_its_depth_is_resampled() -> None:
    """Pixels of the enlarged image look along their own rays, to within the coarser pixel."""
    full = CAMERA.scaled(256, 192)
    u, v = np.meshgrid(np.arange(64), np.arange(48))
    normal = np.array([0.3, -0.2, 1.0])
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)])
    depth = (2.0 / np.tensordot(normal, rays, 1)).astype(np.float32)
    color = np.zeros((192, 256), np.uint8)
    frame = frame_from_messages(
        color_image(color, HEAD), depth_image(depth, HEAD), camera_info(full, HEAD), TOPICS
    )
    u, v = np.meshgrid(np.arange(256), np.arange(192))
    rays = np.stack([(u - full.cx) / full.fx, (v - full.cy) / full.fy, np.ones_like(u)])
    residual = np.tensordot(normal, rays * frame.depth, 1) - 2.0
    half_a_coarse_pixel = 0.5 / CAMERA.fx * (0.3 + 0.2) * np.nanmax(depth)
    assert np.abs(residual).max() < half_a_coarse_pixel
    assert abs(residual.mean()) < half_a_coarse_pixel / 50


def test_a_camera_info_of_another_size_is_scaled_about_pixel_centres() -> None:
    info = camera_info(CAMERA.scaled(128, 96), HEAD)
    frame = frame_from_messages(color_image(RGB, HEAD), depth_image(DEPTH, HEAD), info, TOPICS)
    assert frame.intrinsics.matrix == pytest.approx(CAMERA.matrix)


def test_sizes_of_another_aspect_are_refused() -> None:
    color, depth = color_image(RGB, HEAD), depth_image(DEPTH, HEAD)
    info = camera_info(CAMERA, HEAD)
    with pytest.raises(InputError, match=r"^/depth: is of 64x36 pixels, but /color of 64x48"):
        frame_from_messages(color, depth_image(DEPTH[:36], HEAD), info, TOPICS)
    wide = camera_info(replace(CAMERA, width=128), HEAD)
    with pytest.raises(InputError, match=r"^/info: is of 128x48 pixels, but /color of 64x48"):
        frame_from_messages(color, depth, wide, TOPICS)


def test_a_pose_message_holds_the_transform() -> None:
    T = se3.exp(np.array([1.0, 2.0, 3.0, 0.3, -0.2, 0.1]))
    message = pose_stamped(T, HEAD)
    assert pose_from_message(message, "/pose") == pytest.approx(T, abs=1e-12)


@pytest.mark.parametrize("position", [np.nan, np.inf])
def test_a_pose_that_is_not_finite_is_refused(position: float) -> None:
    T = np.eye(4)
    T[0, 3] = position
    with pytest.raises(InputError, match=r"^/pose: a pose is not finite"):
        pose_from_message(pose_stamped(T, HEAD), "/pose")


def test_rclpy_messages_are_filled_and_read_like_plain_ones() -> None:
    ros = pytest.importorskip("sensor_msgs.msg", reason="needs the ROS message packages")
    filled = fields.copy_fields(color_image(RGB, HEAD), ros.Image())
    assert np.array_equal(color_from_message(filled, "/color"), RGB)
    depth = fields.copy_fields(compressed_depth_image(DEPTH, HEAD), ros.CompressedImage())
    assert depth_from_message(depth, "/depth") == pytest.approx(DEPTH, abs=0.0006)
    info = fields.copy_fields(camera_info(CAMERA, HEAD), ros.CameraInfo())
    assert intrinsics_from_message(info, "/info") == CAMERA
    assert stamp_ns(info.header.stamp) == stamp_ns(HEAD.stamp)


def _flat(data: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(data, np.uint8)
