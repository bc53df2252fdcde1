"""Scenes that odometry is known to stumble over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.bag_frames import errors, recorded_frames, true_poses
from rigs.room import turned_frame, view_after

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.types import RgbdFrame, TrackingState

WALKS_PX = 6
"""How far somebody who walks by moves in the image of 320 pixels from frame to frame."""


def with_somebody(frame: RgbdFrame, number: int) -> RgbdFrame:
    """A quarter of the image is somebody in a striped shirt, 1 m away, who walks by."""
    height, width = frame.depth.shape
    left = (number * WALKS_PX) % (width + width // 4) - width // 4
    columns = slice(max(left, 0), max(left + width // 4, 0))
    stripes = 100 + 40 * np.sin(np.arange(height) / 4)
    color, depth = frame.color.copy(), frame.depth.copy()
    color[:, columns] = stripes[:, None, None].astype(np.uint8)
    depth[:, columns] = 1.0
    return replace(frame, color=color, depth=depth)


def test_a_person_who_walks_by_does_not_drag_the_pose_along() -> None:
    odometry = Odometry(Config())
    found = [
        odometry.process(with_somebody(frame, i)) for i, frame in enumerate(recorded_frames()[:50])
    ]
    metres, _ = errors(found, true_poses()[:50])
    apart = metres[np.isfinite(metres)]
    assert len(apart) > 40
    assert max(apart) < 0.05


def test_a_camera_that_only_turns_does_not_translate() -> None:
    """Without a baseline nothing can be triangulated; depth is measured and needs none."""
    odometry = Odometry(Config())
    for i in range(6):
        T = odometry.process(turned_frame(np.deg2rad(4.0 * i), round(i * 1e9 / 30))).T_odom_camera
        assert T is not None
        assert np.linalg.norm(T[:3, 3]) < 0.01
        assert abs(se3.rotation_angle(T) - np.deg2rad(4.0 * i)) < np.deg2rad(0.3)


@pytest.mark.parametrize(("yaw", "pitch"), [(160, -20), (180, 0), (200, 0), (300, 0)])
def test_after_seconds_without_images_another_part_of_a_room_is_not_taken_for_the_last_one(
    yaw: float, pitch: float
) -> None:
    moved = np.array([0.3, 0.0, -0.2, np.radians(pitch), 0.0, 0.0])
    turn = np.array([0.0, 0.0, 0.0, 0.0, np.radians(yaw), 0.0])
    with Odometry(Config()) as odometry:
        for i in range(3):
            step = se3.exp(np.array([0.01 * i, 0.0, 0.0, 0.0, 0.0, 0.0]))
            before = odometry.process(view_after(step, 1_000_000_000 + i * 33_000_000))
        elsewhere = view_after(se3.exp(moved) @ se3.exp(turn), 9_000_000_000)
        after = odometry.process(elsewhere)
    assert before.state is TrackingState.TRACKING
    assert after.T_odom_camera is None
