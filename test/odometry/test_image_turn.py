"""The turn of a camera by whole images: it is as it is rendered, and it sees through blur."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rigs.room import view_after

from rgbd_glue_ros.geometry import se3, views
from rgbd_glue_ros.odometry.image_turn import turn_between
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config, with_values
from rgbd_glue_ros.types import NANOSECONDS, CameraIntrinsics, Float64, RgbdFrame, View

# a pixel of the small images is half a degree here
TO_TWO_PIXELS = np.deg2rad(1.0)
# where in the time of the blur an image is, nothing says; refinement reaches some degrees
BLUR_PX = 35
TO_HALF_A_BLUR = np.deg2rad(3.8)


def view(frame: RgbdFrame) -> View:
    return View(views.grey(frame.color), frame.depth, frame.intrinsics)


def blurred(frame: RgbdFrame) -> RgbdFrame:
    """As by a fast turn: over a ninth of the width, in which ORB finds nothing again."""
    return replace(frame, color=np.asarray(cv2.blur(frame.color, (BLUR_PX, 1)), np.uint8))


def turned_by(pitch: float, yaw: float) -> Float64:
    return se3.exp(np.array([0, 0, 0, pitch, yaw, 0]))


def off(R: Float64, pitch: float, yaw: float) -> float:
    """By how much a rotation is not that turn, radians."""
    T = se3.from_rotation_translation(R, np.zeros(3))
    return float(np.linalg.norm(se3.log(se3.inverse(turned_by(pitch, yaw)) @ T)[3:]))


@pytest.mark.parametrize(
    ("pitch", "yaw"), [(0.0, 0.1), (0.0, -0.3), (0.2, 0.0), (-0.1, 0.2), (0.0, 0.4)]
)
def test_a_rendered_turn_is_found(pitch: float, yaw: float) -> None:
    before, now = view_after(np.eye(4), 0), view_after(turned_by(pitch, yaw), 1)
    sharp, smeared = (turn_between(view(before), view(seen)) for seen in (now, blurred(now)))
    assert np.linalg.det(sharp) == pytest.approx(1.0)
    assert off(sharp, pitch, yaw) < TO_TWO_PIXELS
    assert off(smeared, pitch, yaw) < TO_HALF_A_BLUR


def test_an_image_has_no_rotation_relative_to_itself() -> None:
    same = view(view_after(np.eye(4), 0))
    assert turn_between(same, same) == pytest.approx(np.eye(3), abs=1e-6)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (3, 700), (700, 3)])
def test_any_two_images_give_a_rotation(height: int, width: int) -> None:
    room = view(view_after(np.eye(4), 0))
    odd = CameraIntrinsics(width, height, 500.0, 500.0, width / 2, height / 2)
    nothing = View(np.zeros((height, width), np.uint8), np.zeros((height, width), np.float32), odd)
    for before, now in [(room, nothing), (nothing, room), (nothing, nothing)]:
        R = turn_between(before, now)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("yaw", [0.2, 0.35, 0.45])
@pytest.mark.parametrize(
    ("step", "stops", "metres", "degrees"),
    [(0.0, True, 0.01, 0.3), (0.2, True, 0.03, 0.6), (0.2, False, 0.01, 0.3)],
)
def test_a_sudden_turn_that_blurs_the_image_is_tracked(
    yaw: float, step: float, stops: bool, metres: float, degrees: float
) -> None:
    """A camera that stands, walks and stops, or walks on: a metre in a second, at 5 Hz."""

    def after(steps: int) -> Float64:
        return se3.exp(np.array([steps * step, 0, 0, 0, 0, 0]))

    odometry = Odometry(with_values(Config(), {"odometry.reset_countdown": 0}))
    period_ns = NANOSECONDS // 5
    for i in range(4):
        odometry.process(view_after(after(i), i * period_ns))
    T = after(3 if stops else 4) @ turned_by(0.0, yaw)
    estimate = odometry.process(blurred(view_after(T, 4 * period_ns)))
    assert estimate.T_odom_camera is not None
    error = se3.log(se3.inverse(T) @ estimate.T_odom_camera)
    assert np.linalg.norm(error[:3]) < metres
    assert np.linalg.norm(error[3:]) < np.deg2rad(degrees)
