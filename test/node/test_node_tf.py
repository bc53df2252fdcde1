"""The node and the frames of a robot, over real DDS and real /tf."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from rgbd_glue_ros.experiments.demo.node_process import NodeProcess
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.extrinsics import T_BODY_OPTICAL
from rgbd_glue_ros.live.patient_lookup import MOST_MISSES
from rgbd_glue_ros.messages.poses import parse_pose, pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.types import NANOSECONDS

pytest.importorskip("rclpy", reason="ROS is not installed")
pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed (scripts/tf2-msgs builds it)")

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TransformStamped
from rigs.faults import rig_environment, running_node, shown
from rigs.ros import OPTICAL_FRAME, PATIENCE_S, START_NS, corner_frame
from rigs.tf import T_BASE_LINK, Robot, transform
from tf2_msgs.msg import TFMessage

from rgbd_glue_ros.messages.transform_tree import TF

PERIOD_NS = NANOSECONDS // 30


@pytest.mark.slow
def test_the_camera_pose_comes_from_tf_once_available_and_is_never_assumed(
    ros_domain: int,
) -> None:
    with running_node(ros_domain, frame_id="base_link") as node, Robot(ros_domain) as robot:
        robot.wait_until_matched()
        robot.publish(corner_frame(START_NS))
        line = node.wait_for_line("no transform", PATIENCE_S)
        assert f"from {OPTICAL_FRAME} to base_link" in line
        robot.tell_where_the_camera_is()
        line = node.wait_for_line("The camera's pose in base_link will come from TF", PATIENCE_S)
        stamps = itertools.count(START_NS + PERIOD_NS, PERIOD_NS)
        robot.publish_until_posed(map(corner_frame, stamps))
        pose = robot.poses[0]
        np.testing.assert_allclose(pose_from_message(pose, "pose"), np.eye(4), atol=1e-9)
        line = node.wait_for_line("TF: found", PATIENCE_S)
        assert "the camera is at (0.200 0.000 0.500) in odom" in line
        robot.wait(lambda: robot.heard, "/tf")
        heard = robot.heard[0]
        assert (heard.header, heard.child_frame_id) == (pose.header, "base_link")
        np.testing.assert_array_equal(pose_from_message(heard, TF), pose_from_message(pose, "pose"))


@pytest.mark.slow
def test_a_static_transform_published_before_the_node_started_is_known(
    ros_domain: int,
) -> None:
    with Robot(ros_domain) as robot:
        robot.tell_where_the_camera_is()
        with running_node(ros_domain, frame_id="base_link"):
            robot.wait_until_matched()
            robot.publish_until_posed(map(corner_frame, itertools.count(START_NS, PERIOD_NS)))
            T = pose_from_message(robot.poses[0], "pose")
            np.testing.assert_allclose(T, np.eye(4), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    "given", [{}, {"frame_id": "base_link", "camera_pose": "'0 0 0 0 0 0'", "publish_tf": False}]
)
def test_no_tf_is_published_for_an_optical_frame_or_if_disabled(
    ros_domain: int, given: dict[str, object]
) -> None:
    with running_node(ros_domain, **given), Robot(ros_domain) as robot:
        robot.wait_until_matched()
        robot.pose_of(corner_frame(START_NS))
        assert robot.node.count_publishers(TF) == 1  # the robot's own


@pytest.mark.slow
def test_with_a_guess_frame_its_motion_is_used_and_its_pose_in_odom_is_published(
    ros_domain: int,
) -> None:
    given = {"frame_id": "base_link", "guess_frame_id": "wheels", "wait_for_transform": 5}
    with running_node(ros_domain, **given), Robot(ros_domain) as robot:
        robot.tell_where_the_camera_is()
        robot.wait_until_matched()
        T_wheels_base = parse_pose("", "4 2 0 0 0 1")
        for at_ns in (START_NS, START_NS + PERIOD_NS):
            frame = corner_frame(at_ns)
            robot.publish(frame)
            wheels = transform("wheels", "base_link", T_wheels_base, at_ns)
            robot.moving.publish(TFMessage(transforms=[wheels]))
            pose = robot.pose_at(at_ns)

        def ours() -> list[TransformStamped]:
            return [t for t in robot.heard if t.child_frame_id == "wheels"]

        robot.wait(lambda: len(ours()) == 2, "/tf")
        assert {t.header.frame_id for t in ours()} == {"odom"}
        assert stamp_ns(ours()[-1].header.stamp) == at_ns
        np.testing.assert_allclose(
            pose_from_message(ours()[-1], TF) @ T_wheels_base,
            pose_from_message(pose, "pose"),
            atol=1e-9,
        )


@pytest.mark.slow
@pytest.mark.parametrize("module", ["rgbd_glue_ros.node", "rigs.node_with_tf2_ros"])
def test_the_guess_is_used_after_a_bag_has_begun_anew(ros_domain: int, module: str) -> None:
    given = {"frame_id": "base_link", "guess_frame_id": "wheels"}
    with (
        shown(NodeProcess(given, rig_environment(ros_domain), module=module)) as node,
        Robot(ros_domain) as robot,
    ):
        robot.tell_where_the_camera_is()
        robot.wait_until_matched()
        begins_ns = (100 * NANOSECONDS, NANOSECONDS)
        for begin_ns in begins_ns:
            stamps = itertools.count(begin_ns, PERIOD_NS)

            def guesses(stamps: Iterator[int] = stamps, begin_ns: int = begin_ns) -> bool:
                at_ns = next(stamps)
                wheels = transform("wheels", "base_link", np.eye(4), at_ns)
                robot.moving.publish(TFMessage(transforms=[wheels]))
                robot.publish(corner_frame(at_ns))
                robot.spin_for(0.1)
                ours = [t for t in robot.heard if t.header.frame_id == "odom"]
                return any(
                    0 <= stamp_ns(t.header.stamp) - begin_ns < NANOSECONDS * 50 for t in ours
                )

            robot.wait(guesses, "odom -> wheels")
        assert any("Time went back" in line for line in node.lines)


@pytest.mark.slow
def test_frames_do_not_wait_for_a_guess_that_never_comes_until_it_comes(ros_domain: int) -> None:
    wait_s = 1.0
    given = {"frame_id": "base_link", "guess_frame_id": "wheels", "wait_for_transform": wait_s}
    with running_node(ros_domain, **given) as node, Robot(ros_domain) as robot:
        robot.tell_where_the_camera_is()
        robot.wait_until_matched()
        stamps = itertools.count(START_NS, PERIOD_NS)
        for _ in range(MOST_MISSES):
            robot.pose_of(corner_frame(next(stamps)))
        start_s = time.monotonic()
        for _ in range(10):
            robot.pose_of(corner_frame(next(stamps)))
        assert time.monotonic() - start_s < 10 * wait_s / 2
        why = "TF: no transform from base_link to wheels (guess_frame_id) within 1.0 s"
        assert "WARN" in node.wait_for_line(why, PATIENCE_S)

        def status() -> DiagnosticStatus:
            return robot.diagnostics[-1].status[0]

        robot.wait(lambda: why in status().message, "the diagnostics")
        assert status().level == DiagnosticStatus.WARN

        def guesses() -> list[TransformStamped]:
            return [t for t in robot.heard if t.header.frame_id == "odom"]

        # the wheels start, and tell of each frame after it has come
        while not guesses():
            at_ns = next(stamps)
            robot.publish(corner_frame(at_ns))
            robot.spin_for(0.1)
            wheels = transform("wheels", "base_link", np.eye(4), at_ns)
            robot.moving.publish(TFMessage(transforms=[wheels]))
            robot.pose_at(at_ns)
            robot.spin_for(0.05)
        node.wait_for_line("TF: the transform from base_link to wheels", PATIENCE_S)
        robot.wait(lambda: not status().message.count("TF"), "the diagnostics")
        assert not [line for line in node.lines if "machine" in line]


@pytest.mark.slow
def test_a_guess_too_far_away_is_ignored_and_costs_no_pose(ros_domain: int) -> None:
    given = {"frame_id": "base_link", "guess_frame_id": "utm", "wait_for_transform": 5}
    with running_node(ros_domain, **given) as node, Robot(ros_domain) as robot:
        robot.tell_where_the_camera_is()
        robot.wait_until_matched()
        T_utm_base = se3.from_rotation_translation(np.eye(3), np.array([0, 1.001e7, 0]))
        for at_ns in range(START_NS, START_NS + 3 * PERIOD_NS, PERIOD_NS):
            far = transform("utm", "base_link", T_utm_base, at_ns)
            robot.moving.publish(TFMessage(transforms=[far]))
            robot.pose_of(corner_frame(at_ns))
        line = node.wait_for_line("base_link to utm (guess_frame_id) is not used", PATIENCE_S)
        assert "(0.0 10010000.0 0.0) m: coordinates must be below 1e+07 m" in line
        assert not [line for line in node.lines if "T_guess_camera" in line]


@pytest.mark.slow
def test_images_of_another_camera_restart_with_its_own_pose(ros_domain: int) -> None:
    with running_node(ros_domain, frame_id="base_link") as node, Robot(ros_domain) as robot:
        robot.tell_where_the_camera_is()
        robot.tell(transform("base_link", "rear_camera", parse_pose("", "-0.3 0 0.4 0 0 3")))
        robot.wait_until_matched()
        stamps = itertools.count(START_NS, PERIOD_NS)
        robot.publish_until_posed(map(corner_frame, stamps))
        first_ns = next(stamps)
        rear = (replace(corner_frame(at_ns), frame_id="rear_camera") for at_ns in stamps)

        def poses_of_rear_camera() -> list[PoseStamped]:
            return [pose for pose in robot.poses if stamp_ns(pose.header.stamp) > first_ns]

        robot.publish(next(rear))
        while not poses_of_rear_camera():
            robot.publish(next(rear))
            robot.spin_for(0.1)
        line = node.wait_for_line("before from", PATIENCE_S)
        assert f"now from the camera 'rear_camera', before from '{OPTICAL_FRAME}'" in line
        node.wait_for_line("the camera is at (-0.300 0.000 0.400) in odom", PATIENCE_S)
        T = pose_from_message(poses_of_rear_camera()[0], "pose")
        np.testing.assert_allclose(T, np.eye(4), atol=1e-9)


@pytest.mark.slow
def test_a_camera_that_moves_on_the_robot_is_reported_while_frames_arrive(ros_domain: int) -> None:
    with running_node(ros_domain, frame_id="base_link") as node, Robot(ros_domain) as robot:
        robot.tell_where_the_camera_is()
        robot.wait_until_matched()
        stamps = itertools.count(START_NS, PERIOD_NS)
        robot.publish_until_posed(map(corner_frame, stamps))
        moved = T_BASE_LINK @ parse_pose("", "0.1 0 0 0 0 0")
        robot.tell(transform("base_link", "camera_link", moved))
        while not any("moves on the robot" in line for line in node.lines):
            robot.pose_of(corner_frame(next(stamps)))
        assert "by 0.100 m" in node.wait_for_line("moves on the robot", PATIENCE_S)


@pytest.mark.slow
def test_one_invalid_transform_does_not_affect_others_in_its_message(ros_domain: int) -> None:
    with running_node(ros_domain, frame_id="base_link"), Robot(ros_domain) as robot:
        broken = []
        for name, number in (("short", 1e-320), ("far", 1e300), ("none", float("nan"))):
            wrong = transform("base_link", name, np.eye(4))
            rotation, to = wrong.transform.rotation, wrong.transform.translation
            rotation.w, to.x = (number, 0.0) if name != "far" else (1.0, number)
            broken.append(wrong)
        robot.tell(
            *broken,
            transform("base_link", "camera_link", T_BASE_LINK),
            transform("camera_link", OPTICAL_FRAME, T_BODY_OPTICAL),
        )
        robot.wait_until_matched()
        robot.publish_until_posed(map(corner_frame, itertools.count(START_NS, PERIOD_NS)))
