"""A camera that is covered and comes back, over real DDS, with pictures of a room."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.types import NANOSECONDS, Float64, RgbdFrame

pytest.importorskip("rclpy", reason="ROS is not installed")

from rigs.faults import node_in
from rigs.ros import OPTICAL_FRAME, PATIENCE_S, START_NS, Rig, corner_frame
from rigs.unseen import covered

PERIOD_NS = NANOSECONDS // 30
COVERED_NS = 5 * NANOSECONDS


def at(stamp_ns: int, frame: RgbdFrame) -> RgbdFrame:
    return replace(frame, stamp_ns=stamp_ns, frame_id=OPTICAL_FRAME)


def poses_of(rig: Rig, frames: Iterable[RgbdFrame]) -> list[Float64]:
    return [pose_from_message(rig.pose_of(frame), "pose") for frame in frames]


@pytest.mark.slow
@pytest.mark.every_python
def test_a_camera_covered_for_five_seconds_is_found_only_where_it_was(
    ros_domain: int,
) -> None:
    room = recorded_frames()
    with node_in(ros_domain, camera_axes="optical") as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        before = poses_of(rig, [at(START_NS + i * PERIOD_NS, room[i]) for i in range(30)])
        now = START_NS + 30 * PERIOD_NS
        for late in range(0, COVERED_NS, NANOSECONDS):
            rig.publish(at(now + late, covered(room[30])))
        node.wait_for_line("Lost at", PATIENCE_S)
        # another room is no place to be found in; of more frames it would be a place to start anew
        now += COVERED_NS
        for i in range(Config().odometry.reset_countdown - 1):
            rig.publish(corner_frame(now + i * PERIOD_NS))
        now += NANOSECONDS
        (found,) = poses_of(rig, [at(now, room[10])])
        assert len(rig.poses) == 31
        error = se3.inverse(before[10]) @ found
        assert np.linalg.norm(error[:3, 3]) < 0.01
        assert se3.rotation_angle(error) < 0.01
        node.wait_for_line("Tracking again", PATIENCE_S)
