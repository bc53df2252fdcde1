"""Camera infos as drivers fill them: one lens under many names, lengths and sizes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rigs import messages as rig

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.camera_info import intrinsics_from_message, pinhole
from rgbd_glue_ros.messages.fields import CameraInfo, RegionOfInterest
from rgbd_glue_ros.messages.frame import FrameTopics, frame_from_messages
from rgbd_glue_ros.messages.making import camera_info, color_image, depth_image, header
from rgbd_glue_ros.types import CameraIntrinsics, LensModel

HEAD = header(1, "camera")
TOPICS = FrameTopics("/color", "/depth", "/info")
CAMERA = CameraIntrinsics(64, 48, 60.0, 61.0, 31.5, 23.5)
D5 = (0.02, -0.03, 0.0005, -0.0004, 0.01)
LENSED = rig.CAMERA
BROWN, FISHEYE = LensModel.BROWN_CONRADY, LensModel.KANNALA_BRANDT


def info(model: str, d: tuple[float, ...]) -> CameraInfo:
    message = camera_info(CAMERA, HEAD)
    return replace(message, distortion_model=model, d=np.array(d, np.float64))


# name, coefficients, and the lens they are
LENSES: list[tuple[str, tuple[float, ...], LensModel, tuple[float, ...]]] = [
    ("plumb_bob", D5, BROWN, D5),
    # what Orbbec's driver sends
    ("plumb_bob", (*D5, 0, 0, 0), BROWN, (*D5, 0, 0, 0)),
    ("plumb_bob", (*D5, 0.1, 0.2, 0.3), BROWN, (*D5, 0.1, 0.2, 0.3)),
    ("plumb_bob", D5[:2], BROWN, (*D5[:2], 0, 0)),
    ("plumb_bob", (*D5, 0), BROWN, D5),
    ("plumb_bob", (*D5, 0.1), BROWN, (*D5, 0.1, 0, 0)),
    ("rational_polynomial", D5, BROWN, D5),
    ("rational_polynomial", (*D5, 0.1, 0.2, 0.3), BROWN, (*D5, 0.1, 0.2, 0.3)),
    ("rational_polynomial", (*D5, *[0] * 7), BROWN, (*D5, *[0] * 7)),
    ("rational_polynomial", (*D5, *[0] * 9), BROWN, (*D5, *[0] * 9)),
    ("rational_polynomial", (*D5, *[0] * 30), BROWN, D5),
    ("thin_prism", (*D5, 0, 0, 0, 1e-4, 0, 0, 0), BROWN, (*D5, 0, 0, 0, 1e-4, 0, 0, 0)),
    ("", D5, BROWN, D5),
    ("radtan", D5[:4], BROWN, D5[:4]),
    ("radial-tangential", D5[:4], BROWN, D5[:4]),
    ("Plumb Bob", D5, BROWN, D5),
    ("PLUMB_BOB", D5, BROWN, D5),
    ("Brown Conrady", D5, BROWN, D5),
    ("Modified Brown Conrady", D5, BROWN, D5),
    ("pinhole", D5, BROWN, D5),
    ("Inverse Brown Conrady", D5, LensModel.INVERSE_BROWN_CONRADY, D5),
    ("equidistant", D5[:4], FISHEYE, D5[:4]),
    ("fisheye", D5[:4], FISHEYE, D5[:4]),
    ("Kannala Brandt4", D5[:4], FISHEYE, D5[:4]),
    ("equidistant", (*D5[:4], 0), FISHEYE, D5[:4]),
    # whatever the model is, this is none
    ("wobbly", (0.0,) * 5, BROWN, ()),
    ("wobbly", (), BROWN, ()),
    ("plumb_bob", (), BROWN, ()),
]


@pytest.mark.parametrize(("model", "d", "lens", "expected"), LENSES)
def test_a_lens_model_is_recognised_by_any_of_its_names_and_its_coefficients(
    model: str, d: tuple[float, ...], lens: LensModel, expected: tuple[float, ...]
) -> None:
    camera = intrinsics_from_message(info(model, d), "/info")
    assert (camera.lens, camera.distortion) == (lens, expected)


@pytest.mark.parametrize(
    ("model", "d"),
    [("wobbly", D5), ("equidistant", D5), ("plumb_bob", (0.1,) * 15), ("fov", (0.9,))],
)
def test_an_unsupported_lens_model_is_refused_with_the_supported_names(
    model: str, d: tuple[float, ...]
) -> None:
    with pytest.raises(InputError, match=r"are not supported; rectify .* plumb_bob, .*equidistant"):
        intrinsics_from_message(info(model, d), "/info")


@pytest.mark.parametrize(
    "camera",
    [
        replace(CAMERA, distortion=D5, lens=lens)
        if lens is not FISHEYE
        else replace(CAMERA, distortion=D5[:4], lens=lens)
        for lens in LensModel
    ],
    ids=lambda camera: camera.lens.name,
)
def test_every_lens_model_survives_the_round_trip_through_a_message(
    camera: CameraIntrinsics,
) -> None:
    assert intrinsics_from_message(camera_info(camera, HEAD), "/info") == camera


COLOR = color_image(np.zeros((48, 64, 3), np.uint8), HEAD)
DEPTH = depth_image(np.ones((48, 64), np.float32), HEAD)


def camera_of(message: CameraInfo, color: str = "/color") -> CameraIntrinsics:
    topics = replace(TOPICS, color=color)
    return frame_from_messages(COLOR, DEPTH, message, topics).intrinsics


PLAIN = camera_info(CAMERA, HEAD)

# whatever it says besides, the camera is this one
SIZES: dict[str, tuple[CameraInfo, str]] = {
    "as it should be": (PLAIN, "/color"),
    "without P, of a rectified image": (replace(PLAIN, p=np.zeros(12)), "/image_rect"),
    "without K": (replace(PLAIN, k=np.zeros(9)), "/color"),
    "without size": (replace(PLAIN, width=0, height=0), "/color"),
    "of the full image, in bins": (
        replace(camera_info(CAMERA.scaled(128, 96), HEAD), binning_x=2, binning_y=2),
        "/color",
    ),
    "of the full image, halved": (camera_info(CAMERA.scaled(128, 96), HEAD), "/color"),
    "of a region": (
        replace(
            camera_info(replace(CAMERA, width=90, height=60, cx=41.5, cy=28.5), HEAD),
            roi=RegionOfInterest(x_offset=10, y_offset=5, width=64, height=48),
        ),
        "/color",
    ),
}


@pytest.mark.parametrize("name", SIZES)
def test_the_camera_is_that_of_the_unrectified_image(name: str) -> None:
    camera = camera_of(*SIZES[name])
    assert (camera.width, camera.height) == (64, 48)
    np.testing.assert_allclose(camera.matrix, CAMERA.matrix)


@pytest.mark.parametrize(
    ("message", "cause"),
    [
        (camera_info(replace(CAMERA, width=0, height=0, cx=90.0), HEAD), "has no size"),
        (camera_info(replace(CAMERA, width=32, height=24), HEAD), "does not fit its own size"),
        (replace(PLAIN, width=0), "an image of 0x48 pixels"),
        (replace(PLAIN, k=np.zeros(9), p=np.zeros(12)), "is not calibrated"),
        (replace(PLAIN, k=PLAIN.k + 2.5 * np.eye(9)[1]), "K has a skew of 2.5 pixels, which"),
        (camera_info(replace(CAMERA, width=64, height=40), HEAD), "64x40 pixels, but /color has"),
    ],
)
def test_an_info_that_does_not_fit_the_image_is_refused(message: CameraInfo, cause: str) -> None:
    with pytest.raises(InputError, match=r"^/info: ") as error:
        camera_of(message)
    assert cause in str(error.value)


@pytest.mark.parametrize("factor", [2.0, 1.5, 0.5])
def test_a_matrix_for_another_resolution_than_the_stated_one_is_refused(factor: float) -> None:
    scaled = CAMERA.scaled(round(64 * factor), round(48 * factor))
    message = camera_info(replace(scaled, width=64, height=48), HEAD)
    size = f"{scaled.width}x{scaled.height}"
    with pytest.raises(InputError, match=f"does not fit its own size, 64x48, but one of {size}"):
        camera_of(message)
    # as it should have been stated, it is scaled
    found = camera_of(replace(message, width=scaled.width, height=scaled.height))
    np.testing.assert_allclose(found.matrix, CAMERA.matrix)


def test_a_region_far_from_the_centre_of_its_sensor_keeps_its_camera() -> None:
    """Declared, at a corner of the sensor, or published as a whole image, at one of its sides."""
    sensor = CAMERA.scaled(256, 192)
    corner = replace(camera_info(sensor, HEAD), roi=RegionOfInterest(0, 0, 48, 64))
    assert camera_of(corner).cx == pytest.approx(sensor.cx)
    side = replace(sensor, width=64, height=48, cx=sensor.cx - 128, cy=23.5)
    assert camera_of(camera_info(side, HEAD)).cx == pytest.approx(sensor.cx - 128)


@pytest.mark.parametrize(("at", "rest"), [(1, 1e-6), (3, -3e-5), (6, 1e-8), (8, 1e-7)])
def test_what_rounding_leaves_of_zeros_and_ones_does_not_matter(at: int, rest: float) -> None:
    message = replace(PLAIN, k=PLAIN.k + rest * np.eye(9)[at])
    assert intrinsics_from_message(message, "/info") == CAMERA


@pytest.mark.parametrize(("at", "wrong"), [(3, 0.05), (6, 1e-3), (8, -1e-3)])
def test_more_than_rounding_in_place_of_a_zero_or_one_is_refused(at: int, wrong: float) -> None:
    message = replace(PLAIN, k=PLAIN.k + wrong * np.eye(9)[at])
    with pytest.raises(InputError, match="not fx 0 cx, 0 fy cy, 0 0 1"):
        intrinsics_from_message(message, "/info")
    with pytest.raises(InputError, match=r"K has a skew of 0\.05 pixels"):
        intrinsics_from_message(replace(PLAIN, k=PLAIN.k + 0.05 * np.eye(9)[1]), "/info")


def test_the_camera_comes_back_from_its_info() -> None:
    rational = replace(LENSED, distortion=tuple(0.01 * i for i in range(1, 9)))
    for camera in (LENSED, rational, replace(LENSED, distortion=())):
        assert intrinsics_from_message(camera_info(camera, HEAD), "/info") == camera


def test_cropping_shifts_and_binning_scales_the_camera() -> None:
    """A 3D point's pixel, cropped and binned by hand, is where the camera says it is."""
    info = replace(
        camera_info(LENSED, HEAD),
        roi=RegionOfInterest(x_offset=8, y_offset=4, width=40, height=20),
        binning_x=2,
        binning_y=4,
    )
    camera = intrinsics_from_message(info, "/info")
    assert (camera.width, camera.height) == (20, 5)
    x, y, z = 0.2, -0.1, 2.0
    u, v = LENSED.fx * x / z + LENSED.cx, LENSED.fy * y / z + LENSED.cy
    # the first bin spans pixels 8 to 9, so its centre is at 8.5
    assert camera.fx * x / z + camera.cx == pytest.approx((u - 8.5) / 2)
    assert camera.fy * y / z + camera.cy == pytest.approx((v - 5.5) / 4)


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"k": np.zeros(9), "p": np.zeros(12)}, "K is all zeros: the camera is not calibrated"),
        ({"k": np.full(9, np.nan)}, "K is [[nan, nan, nan], ["),
        ({"k": np.array([60, 0, np.inf, 0, 60, 23, 0, 0, 1])}, "K is [[60.0, 0.0, inf], ["),
        ({"k": np.array([-60.0, 0, 31, 0, 60, 23, 0, 0, 1])}, "fx of K is -60.0"),
        ({"k": np.array([60.0, 0, 31, 0, 0, 23, 0, 0, 1])}, "fy of K is 0.0"),
        ({"k": np.array([60.0, 0, 31, 0, 60, 23, 9, 0, 1])}, "not fx 0 cx, 0 fy cy, 0 0 1"),
        (
            {"k": np.array([60.0, 0, 31, 0, 9e4, 23, 0, 0, 1])},
            "fx = 60, fy = 90000, cx = 31, cy = 23 of K are implausible for images of 64x48",
        ),
        ({"d": np.array([np.nan] * 5)}, "D is"),
        ({"distortion_model": "equidistant"}, "distortion model 'equidistant' are not supported"),
        ({"width": 0}, "an image of 0x48 pixels"),
        ({"roi": RegionOfInterest(30, 0, 40, 48)}, "is not within 64x48"),
        ({"binning_x": 65}, "an image of 0x48 pixels"),
    ],
)
def test_an_invalid_camera_info_is_refused(changes: dict[str, Any], cause: str) -> None:
    info: CameraInfo = replace(camera_info(LENSED, HEAD), **changes)
    with pytest.raises(InputError, match=r"^/info: ") as caught:
        intrinsics_from_message(info, "/info")
    assert cause in str(caught.value)


def test_the_camera_of_a_rectified_image_is_p_without_distortion() -> None:
    info = camera_info(LENSED, HEAD)
    p = np.array([50.0, 0, 30, 0, 0, 50, 20, 0, 0, 0, 1, 0])
    color, depth = color_image(rig.RGB, HEAD), depth_image(rig.DEPTH, HEAD)
    for name in ("/camera/rgb/image_rect_color", "/left/image_rect/compressed"):
        topics = replace(TOPICS, color=name)
        frame = frame_from_messages(color, depth, replace(info, p=p), topics)
        assert frame.intrinsics == CameraIntrinsics(64, 48, 50.0, 50.0, 30.0, 20.0)
        without_p = frame_from_messages(color, depth, replace(info, p=np.zeros(12)), topics)
        assert without_p.intrinsics == replace(LENSED, distortion=())
    raw_topics = replace(TOPICS, color="/camera_rect/image_direct")
    frame = frame_from_messages(color, depth, replace(info, p=p), raw_topics)
    assert frame.intrinsics == LENSED


def test_an_unknown_model_without_distortion_is_accepted() -> None:
    info = replace(camera_info(LENSED, HEAD), distortion_model="", d=np.zeros(0))
    assert intrinsics_from_message(info, "/info").distortion == ()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("number", [np.inf, -np.inf, np.nan])
def test_a_matrix_that_is_not_finite_is_refused_without_a_warning(number: float) -> None:
    for at in range(9):
        matrix = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
        # with skew, which alone would be said
        matrix[0, 1] = 2.0
        matrix.flat[at] = number
        with pytest.raises(InputError, match="not fx 0 cx, 0 fy cy, 0 0 1"):
            pinhole(matrix, 640, 480, "K", "/camera_info")
