"""The picture of the matches."""

from __future__ import annotations

import numpy as np
from rigs.room import CAMERA, room_frame

from rgbd_glue_ros.geometry.camera import project
from rgbd_glue_ros.live.match_image import CREDIBLE, REJECTED, VISUAL, match_image, rejected
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import load_preset
from rgbd_glue_ros.types import (
    Correspondences,
    OdometryEstimate,
    RegistrationResult,
    RegistrationStatus,
    TrackingState,
)


def matches(*points: tuple[float, float, float]) -> Correspondences:
    at = np.array(points).reshape(-1, 3)
    return Correspondences(at, at, np.ones(len(at)))


def test_every_kind_of_match_is_drawn_in_its_colour_at_the_point_in_the_frame() -> None:
    left, middle, right = (-0.3, 0.2, 2.0), (0.0, 0.2, 2.0), (0.3, 0.2, 2.0)
    result = RegistrationResult(
        np.eye(4),
        RegistrationStatus.OK,
        visual=matches(left),
        visual_inliers=matches(left),
        geometric=matches(middle, right),
        credible=matches(middle),
        filtered=True,
        epsilon_m=0.041,
    )
    np.testing.assert_array_equal(rejected(result).source, [right])
    estimate = OdometryEstimate(0, TrackingState.TRACKING, np.eye(4), registration=result)
    frame = room_frame(0.0)
    image = match_image(frame, estimate)
    assert image.shape == frame.color.shape
    for point, rgb in ((left, VISUAL), (middle, CREDIBLE), (right, REJECTED)):
        u, v = np.round(project(np.array([point]), CAMERA)[0]).astype(int)
        np.testing.assert_array_equal(image[v, u], rgb)


def test_a_grey_frame_and_one_without_a_registration_get_an_image_too() -> None:
    frame = room_frame(0.0)
    for color in (frame.color, frame.color[:, :, 0]):
        seen = type(frame)(frame.stamp_ns, color, frame.depth, frame.intrinsics)
        image = match_image(seen, Odometry(load_preset("live")).process(seen))
        assert image.shape == (*frame.depth.shape, 3)
