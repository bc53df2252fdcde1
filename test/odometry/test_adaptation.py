"""The odometry goes by what a camera can show: few pixels, few frames a second, one wall."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rigs.bag_frames import errors, recorded_frames, true_poses
from rigs.room import panned_frame

from rgbd_glue_ros.features.geometric import GridFpfh
from rgbd_glue_ros.geometry.normals import spacing_px
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config, FeaturesConfig, with_values
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.types import (
    NANOSECONDS,
    CameraIntrinsics,
    OdometryEstimate,
    RgbdFrame,
    TrackingState,
    View,
)

PERIOD_NS = NANOSECONDS // 30


def blank_view(width: int, height: int) -> View:
    camera = CameraIntrinsics(width, height, 300.0, 300.0, width / 2, height / 2)
    return View(np.zeros((height, width), np.uint8), np.ones((height, width), np.float32), camera)


@pytest.mark.parametrize(
    ("width", "height"),
    [(160, 120), (256, 192), (320, 240), (540, 360), (640, 480), (848, 480), (1280, 720)],
)
def test_an_image_of_any_size_has_about_as_many_planes(width: int, height: int) -> None:
    step = spacing_px(blank_view(width, height), 8)
    assert 0.65 * 4800 < (width // step) * (height // step) < 1.35 * 4800


@pytest.mark.parametrize(("width", "height"), [(848, 480), (1280, 720), (1920, 1080)])
def test_a_large_image_costs_as_many_pixels_and_descriptors_as_one_of_640x480(
    width: int, height: int
) -> None:
    """Noise: wherever a pixel or descriptor can be, there is one."""

    def counts(width: int, height: int) -> list[int]:
        blank = blank_view(width, height)
        noise = np.random.default_rng(0).integers(0, 256, blank.grey.shape, np.uint8)
        view = replace(blank, grey=noise)
        grid = GridFpfh(FeaturesConfig()).extract(view)
        return [grid.points[..., 0].size, *(len(p.points) for p in model_of(view, 8).pixels)]

    np.testing.assert_allclose(counts(width, height), counts(640, 480), rtol=0.35)


def halved(frame: RgbdFrame) -> RgbdFrame:
    """Pixel i of the smaller images is centred on pixel 2 i."""
    K = frame.intrinsics
    camera = CameraIntrinsics(K.width // 2, K.height // 2, K.fx / 2, K.fy / 2, K.cx / 2, K.cy / 2)
    color = np.asarray(cv2.pyrDown(frame.color), np.uint8)
    depth = np.ascontiguousarray(frame.depth[::2, ::2])
    return replace(frame, color=color, depth=depth, intrinsics=camera)


def track(frames: list[RgbdFrame], config: Config | None = None) -> list[OdometryEstimate]:
    with Odometry(config or Config()) as odometry:
        return [odometry.process(frame) for frame in frames]


def test_a_camera_of_160x120_pixels_is_tracked() -> None:
    frames = [halved(frame) for frame in recorded_frames()[:60]]
    assert frames[0].depth.shape == (120, 160)
    metres, radians = errors(track(frames), true_poses()[:60])
    assert metres.max() < 0.03
    assert radians.max() < 0.03


def test_a_camera_with_five_frames_per_second_is_tracked() -> None:
    metres, radians = errors(track(list(recorded_frames()[::6])), true_poses()[::6])
    assert metres.max() < 0.02
    assert radians.max() < 0.02


def panned(config: Config) -> list[bool]:
    """Which frames of a camera that turns by a radian become keyframes."""
    way = np.arange(0, 1.0, 0.1)
    frames = [
        replace(panned_frame(angle), stamp_ns=(1 + i) * PERIOD_NS) for i, angle in enumerate(way)
    ]
    return [estimate.is_keyframe for estimate in track(frames, config)]


@pytest.mark.slow
def test_a_frame_with_little_overlap_becomes_a_keyframe_however_near_it_is() -> None:
    far = {"odometry.keyframe_translation": 100.0, "odometry.keyframe_rotation": 100.0}
    by_distance_alone = panned(with_values(Config(), {**far, "odometry.keyframe_overlap": 0.0}))
    assert by_distance_alone == [True] + [False] * 9
    by_overlap = panned(with_values(Config(), {**far, "odometry.keyframe_overlap": 0.7}))
    assert by_overlap[0]
    assert 1 <= sum(by_overlap[1:]) <= 5


def walls_alone(frame: RgbdFrame) -> RgbdFrame:
    """A frame whose depth says that the camera is nowhere near: it fits no keyframe."""
    v, u = np.mgrid[: frame.depth.shape[0], : frame.depth.shape[1]]
    depth = (1.0 + 0.3 * np.sin(u / 15.0) * np.cos(v / 20.0)).astype(np.float32)
    return replace(frame, color=np.zeros_like(frame.color), depth=depth)


@pytest.mark.slow
@pytest.mark.parametrize(("rate_hz", "lost"), [(30, 30), (5, 5), (1, 3)])
def test_a_restart_waits_for_both_time_and_frames(rate_hz: int, lost: int) -> None:
    frames = [*recorded_frames()[:3], *[walls_alone(recorded_frames()[3])] * 40]
    period_ns = NANOSECONDS // rate_hz
    timed = [replace(frame, stamp_ns=(1 + i) * period_ns) for i, frame in enumerate(frames)]
    for i in range(3):  # the motion before is the recording's own
        timed[i] = replace(timed[i], stamp_ns=timed[3].stamp_ns - period_ns - (2 - i) * PERIOD_NS)
    states = [estimate.state for estimate in track(timed)]
    assert states[:3] == [TrackingState.TRACKING] * 3
    without_pose = states[3:].index(TrackingState.TRACKING)
    assert abs(without_pose + 1 - lost) <= 1
