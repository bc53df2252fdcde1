"""A camera that is covered and comes back, over real DDS, with pictures of a room."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames
from rigs.scenes import SCENES

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.topics import MATCHES
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.types import NANOSECONDS, Float64, RgbdFrame

pytest.importorskip("rclpy", reason="ROS is not installed")

from diagnostic_msgs.msg import DiagnosticStatus
from rigs.faults import node_in, rig_node
from rigs.node_without_pictures import REFUSAL
from rigs.ros import OPTICAL_FRAME, PATIENCE_S, START_NS, Rig, corner_frame
from rigs.unseen import covered
from sensor_msgs.msg import Image
from std_srvs.srv import Empty

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


@pytest.mark.slow
def test_a_restart_at_the_last_pose_is_a_warning_until_a_reset(ros_domain: int) -> None:
    room, countdown = recorded_frames(), 5
    now = itertools.count(START_NS, PERIOD_NS)

    def told(rig: Rig) -> tuple[bytes, str, dict[str, str]]:
        rig.diagnostics.clear()
        rig.wait(lambda: rig.diagnostics, "diagnostics")
        status = rig.diagnostics[-1].status[0]
        return status.level, status.message, {item.key: item.value for item in status.values}

    parameters = {
        "reset_countdown": countdown,
        "odometry.reset_delay": 2.0,
        "always_process_most_recent_frame": False,
    }
    with node_in(ros_domain, **parameters) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        poses_of(rig, [at(next(now), room[i]) for i in range(5)])
        away = START_NS + 3 * NANOSECONDS
        for i in range(countdown - 1):
            rig.publish(corner_frame(away + i * PERIOD_NS))
        rig.pose_of(corner_frame(away + countdown * PERIOD_NS))
        line = node.wait_for_line("Not recognised at 4.", PATIENCE_S)
        assert "[WARN]" in line
        assert "restarted at the last pose, which may be 3." in line
        assert not [line for line in node.lines if "Tracking again" in line]
        rig.pose_of(corner_frame(away + 8 * PERIOD_NS))
        level, message, values = told(rig)
        assert level == DiagnosticStatus.WARN
        assert message.startswith("not recognised at 4.")
        assert (values["state"], values["blind_restarts"]) == ("tracking", "1")
        assert 2.5 < float(values["position_sigma_m"]) < 4
        reset = rig.node.create_client(Empty, "/rgbd_odometry/reset_odom")
        rig.wait(reset.service_is_ready, "the service")
        rig.wait(reset.call_async(Empty.Request()).done, "the answer")
        rig.pose_of(corner_frame(away + 9 * PERIOD_NS))
        level, message, values = told(rig)
        assert (level, message, values["blind_restarts"]) == (DiagnosticStatus.OK, "tracking", "0")


@pytest.mark.slow
def test_before_a_bare_wall_the_node_warns_that_the_pose_may_be_off(ros_domain: int) -> None:
    frames = islice(SCENES["a bare wall"].noisy_frames(seed=0), 20)
    with node_in(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        poses_of(rig, [at(START_NS + i * PERIOD_NS, frame) for i, frame in enumerate(frames)])
        line = node.wait_for_line("the images have not shown all of the motion", PATIENCE_S)
        assert "[WARN]" in line
        assert "guess_frame_id" in line
        rig.diagnostics.clear()
        rig.wait(lambda: rig.diagnostics, "diagnostics")
        status = rig.diagnostics[-1].status[0]
        assert status.level == DiagnosticStatus.WARN
        assert "the images have not shown all of the motion" in status.message


@pytest.mark.slow
def test_a_bag_that_begins_anew_has_a_first_pose_again(ros_domain: int) -> None:
    with node_in(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        for begin_s in (100, 1):
            # the first after a jump is held back until the next
            for i in range(3):
                rig.publish(corner_frame(begin_s * NANOSECONDS + i * PERIOD_NS))
            node.wait_for_line(f"Tracking: first pose at {begin_s}.", PATIENCE_S)


@pytest.mark.slow
def test_a_frame_whose_stamp_is_two_seconds_ahead_restarts_nothing(ros_domain: int) -> None:
    stamps = [START_NS + i * PERIOD_NS for i in range(15)]
    with node_in(ros_domain), Rig(ros_domain) as rig:
        rig.wait_until_matched()
        for stamp in stamps[:12]:
            rig.pose_of(corner_frame(stamp))
        rig.publish(corner_frame(stamps[11] + 2 * NANOSECONDS))
        for stamp in stamps[12:]:
            rig.pose_of(corner_frame(stamp))
        assert [stamp_ns(pose.header.stamp) for pose in rig.poses] == stamps


@pytest.mark.slow
def test_pictures_that_cannot_be_drawn_cost_no_pose_and_are_told_once(ros_domain: int) -> None:
    with (
        rig_node(ros_domain, "node_without_pictures") as node,
        Rig(ros_domain) as rig,
    ):
        # without a subscriber only the viewer fails, and later the picture of the matches
        rig.wait_until_matched()
        poses_of(rig, [corner_frame(START_NS + i * PERIOD_NS) for i in range(3)])
        node.wait_for_line(REFUSAL, PATIENCE_S)
        rig.node.create_subscription(Image, MATCHES, lambda _: None, 10)
        rig.wait(lambda: rig.node.count_publishers(MATCHES), "the publisher")
        poses_of(rig, [corner_frame(START_NS + i * PERIOD_NS) for i in range(3, 20)])
        rig.diagnostics.clear()
        rig.wait(lambda: rig.diagnostics, "diagnostics")
        values = {item.key: item.value for item in rig.diagnostics[-1].status[0].values}
        assert (values["tracked"], values["dropped_failed"]) == ("20", "0")
        assert len([line for line in node.lines if f"ZeroDivisionError: {REFUSAL}" in line]) == 1
