"""``rgbd-glue watch`` over real DDS: what it shows of an odometry, and what it records."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from rigs.disks import full_after
from rigs.paths import ROOT
from rigs.watch_process import TO

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.experiments.demo.node_process import NodeProcess, ros_environment
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.monitor import Monitor
from rgbd_glue_ros.live.topics import DIAGNOSTICS, ODOM
from rgbd_glue_ros.messages import making
from rgbd_glue_ros.messages.making import copy_fields
from rgbd_glue_ros.trajectories.tum import read_tum
from rgbd_glue_ros.types import Float64, OdometryEstimate, TrackingState

pytest.importorskip("rclpy", reason="ROS is not installed")

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rigs.faults import COMPILE_S, node_in, rig_environment, rig_node, running_node, shown
from rigs.ros import PATIENCE_S, START_S, Rig, corner_frame

from rgbd_glue_ros.node.diagnostics import diagnostics_message
from rgbd_glue_ros.node.node import NODE_NAME

pytestmark = pytest.mark.slow

PERIOD_NS = 20_000_000


def pose_at(index: int) -> Float64:
    """2 cm and half a degree a frame."""
    T = se3.exp(np.array([0, 0, 0, 0, 0, np.radians(index / 2)]))
    T[:3, 3] = 0.02 * index, 0.0, 0.5
    return T


class KnownOdometry(Closing):
    """Publishes what an odometry node does, with poses and states that a test chooses."""

    def __init__(self, domain: int, namespace: str = "") -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node(NODE_NAME, context=self._context, namespace=namespace)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        # more than a camera ever has at once: a test publishes all of them without a pause
        self._odom = self.node.create_publisher(OdometryMessage, ODOM, 1000)
        self._diagnostics = self.node.create_publisher(DiagnosticArray, DIAGNOSTICS, 10)
        self.stamps_ns: list[int] = []

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def wait(self, condition: Callable[[], object], what: str) -> None:
        """Handles events until ``condition`` holds."""
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline, f"waited in vain for {what}"
            # matches of other participants wake nothing here, so look for them now and then
            self._executor.spin_once(timeout_sec=0.05)

    def wait_until_watched(self) -> None:
        for publisher in (self._odom, self._diagnostics):
            self.wait(publisher.get_subscription_count, publisher.topic_name)

    def publish(self, indices: range, shift_m: float = 0.0) -> None:
        """Poses with the stamps of a camera, the last of which is now."""
        first_ns = time.time_ns() - len(indices) * PERIOD_NS
        for index in indices:
            T = pose_at(index)
            T[0, 3] += shift_m
            self.stamps_ns.append(first_ns + (index - indices.start + 1) * PERIOD_NS)
            head = making.header(self.stamps_ns[-1], "odom")
            stamped = copy_fields(making.pose_stamped(T, head), PoseStamped())
            message = OdometryMessage(header=stamped.header)
            message.pose.pose = stamped.pose
            self._odom.publish(message)

    def publish_null(self) -> None:
        """What stands for a frame without a pose."""
        message = OdometryMessage()
        copy_fields(making.header(time.time_ns(), "odom"), message.header)
        message.pose.pose.orientation.w = 0.0
        self._odom.publish(message)

    def say(self, state: TrackingState, why: str = "") -> None:
        """The node's state on /diagnostics."""
        monitor = Monitor()
        monitor.processed(OdometryEstimate(0, state, None), 0, 0, why)
        message = f"{state.value}: {why}" if why else state.value
        level = DiagnosticStatus.WARN if why else DiagnosticStatus.OK
        values = monitor.values(time.monotonic_ns())
        self._diagnostics.publish(
            diagnostics_message(self.node, "odometry", level, message, values)
        )


@contextmanager
def watching(domain: int, *arguments: str, to: Path | None = None) -> Iterator[NodeProcess]:
    """The command, whose lines are shown when the test fails."""
    environment = {**rig_environment(domain), **({} if to is None else {TO: str(to)})}
    process = NodeProcess({}, environment, arguments, module="rigs.watch_process")
    with shown(process) as watch:
        watch.wait_for_line("watching ", PATIENCE_S)
        yield watch
        assert not [line for line in watch.lines if "Traceback" in line]


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_poses_are_shown_and_recorded_to_the_last_until_a_signal(
    ros_domain: int, tmp_path: Path, how: signal.Signals
) -> None:
    path = tmp_path / "trajectory.txt"
    with watching(ros_domain, to=path) as watch, KnownOdometry(ros_domain) as odometry:
        odometry.wait_until_watched()
        odometry.publish(range(51))
        line = watch.wait_for_line("x 1.000 y 0.000 z 0.500 m, path 1.0 m, turn 25°", PATIENCE_S)
        assert line.startswith("tracking, ")
        assert " Hz, latency " in line
        assert watch.stop(how) == 0
        recorded = read_tum(path)
        assert recorded.stamps_ns.tolist() == odometry.stamps_ns
        np.testing.assert_allclose(recorded.poses, [pose_at(i) for i in range(51)], atol=1e-12)
        assert watch.lines[-1] == f"51 poses, path 1.0 m; 51 poses in {path}"


def test_where_nobody_publishes_it_says_what_to_do_and_leaves_no_file(
    ros_domain: int, tmp_path: Path
) -> None:
    path = tmp_path / "out" / "trajectory.txt"
    with watching(ros_domain, to=path) as watch:
        line = watch.wait_for_line("nobody publishes /odom: start the node", PATIENCE_S)
        assert "`odometry --camera realsense_d400`" in line
        assert f"the same ROS_DOMAIN_ID, which is {ros_domain} here" in line
        assert "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET" in line
        assert watch.stop() == 0
        assert watch.lines[-1] == "no pose came, no file"
    assert not path.exists()


def test_a_node_in_another_namespace_is_named_with_what_to_give(ros_domain: int) -> None:
    with KnownOdometry(ros_domain, "/robot") as odometry:
        with watching(ros_domain) as watch:

            def is_named() -> bool:
                odometry.say(TrackingState.TRACKING)
                return any("but /robot/rgbd_odometry runs" in line for line in watch.lines)

            odometry.wait(is_named, "the name of the node")
            assert "-r __ns:=/robot" in watch.wait_for_line("runs: give its namespace", PATIENCE_S)
        with watching(ros_domain, "-r", "__ns:=/robot") as watch:
            assert watch.lines[0] == "watching /robot/odom; Ctrl-C ends it"
            odometry.wait_until_watched()
            odometry.publish(range(3))
            watch.wait_for_line("tracking, ", PATIENCE_S)
        with watching(ros_domain, "-r", "odom:=/robot/odom") as watch:
            odometry.wait_until_watched()
            odometry.publish(range(3))
            watch.wait_for_line("tracking, ", PATIENCE_S)


def test_a_lost_camera_is_shown_with_the_nodes_reason_and_null_poses_are_none(
    ros_domain: int, tmp_path: Path
) -> None:
    path = tmp_path / "trajectory.txt"
    with watching(ros_domain, to=path) as watch, KnownOdometry(ros_domain) as odometry:
        odometry.wait_until_watched()
        odometry.publish(range(11))
        odometry.publish_null()
        watch.wait_for_line("x 0.200 ", PATIENCE_S)
        odometry.say(TrackingState.LOST, "too few pixels show structure")
        line = watch.wait_for_line("lost for ", PATIENCE_S)
        assert "last at x 0.200 y 0.000 z 0.500 m, path 0.2 m" in line
        assert line.endswith(": too few pixels show structure")
        assert watch.stop() == 0
    assert len(read_tum(path)) == 11


def test_a_node_that_ends_and_begins_anew_is_followed_and_its_path_starts_anew(
    ros_domain: int, tmp_path: Path
) -> None:
    path = tmp_path / "trajectory.txt"
    with watching(ros_domain, to=path) as watch:
        with KnownOdometry(ros_domain) as odometry:
            odometry.wait_until_watched()
            odometry.publish(range(51))
            watch.wait_for_line("path 1.0 m", PATIENCE_S)
        watch.wait_for_line("/odom has no publisher any more: the node has ended", PATIENCE_S)
        with KnownOdometry(ros_domain) as odometry:
            odometry.wait_until_watched()
            odometry.publish(range(11), shift_m=5.0)
            watch.wait_for_line("the odometry began anew", PATIENCE_S)
            watch.wait_for_line("x 5.200 y 0.000 z 0.500 m, path 0.2 m", PATIENCE_S)
        assert watch.stop() == 0
    assert len(read_tum(path)) == 62
    assert path.read_text().splitlines()[52].startswith("# the odometry began anew")


def test_a_full_disk_ends_it_with_one_line_and_whole_poses(ros_domain: int, tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    with (
        KnownOdometry(ros_domain) as odometry,
        full_after(20_000),
        watching(ros_domain, to=path) as watch,
    ):
        odometry.wait_until_watched()
        odometry.publish(range(400))
        watch.wait_for_line(f"{path}: cannot be written (File too large)", PATIENCE_S)
        assert watch.wait_for_end(PATIENCE_S) == 2
    assert 100 < len(read_tum(path)) < 400


def test_a_reader_that_has_seen_enough_ends_it(ros_domain: int) -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "rgbd_glue_ros", "watch"],
        cwd=ROOT,
        env={**os.environ, **ros_environment(ros_domain)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "watching /odom; Ctrl-C ends it\n"
        process.stdout.close()
        assert process.wait(PATIENCE_S) == 128 + signal.SIGPIPE
        assert process.stderr is not None
        assert process.stderr.read() == ""


def test_a_node_that_is_not_ready_says_on_diagnostics_what_it_does(ros_domain: int) -> None:
    with rig_node(ros_domain, "preparing_node") as node, watching(ros_domain) as watch:
        line = watch.wait_for_line("no pose yet, initializing: ", START_S)
        assert line.endswith(": warming up; the very first time this compiles, for a minute or two")
        assert node.stop() == 0


def feed_until(rig: Rig, watch: NodeProcess, text: str) -> str:
    """Gives the node frames until the watch, which may be matched last of all, shows a line."""
    deadline = time.monotonic() + PATIENCE_S
    while not any(text in line for line in watch.lines):
        assert time.monotonic() < deadline, f"waited in vain for {text!r}"
        rig.pose_of(corner_frame(time.time_ns()))
    return watch.wait_for_line(text, PATIENCE_S)


def recorded_stamps_ns(path: Path) -> list[int]:
    stamps_ns: list[int] = read_tum(path).stamps_ns.tolist()
    return stamps_ns


def feed_recorded(rig: Rig, path: Path) -> list[int]:
    """Stamps of ten more frames, once the pose of the last one is recorded."""
    stamps_ns = []
    for _ in range(10):
        stamps_ns.append(time.time_ns())
        rig.pose_of(corner_frame(stamps_ns[-1]))
    rig.wait(lambda: recorded_stamps_ns(path)[-1] == stamps_ns[-1], "the last pose in the record")
    return stamps_ns


@pytest.mark.every_python
def test_the_node_is_watched_from_before_its_start_until_after_its_restart(
    ros_domain: int, tmp_path: Path
) -> None:
    path = tmp_path / "trajectory.txt"
    with watching(ros_domain, to=path) as watch:
        watch.wait_for_line("nobody publishes /odom", PATIENCE_S)
        with node_in(ros_domain), Rig(ros_domain) as rig:
            watch.wait_for_line("no pose yet, initializing", START_S)
            rig.wait_until_matched()
            line = feed_until(rig, watch, "tracking, ")
            assert "latency " in line
            assert "path 0.0 m, turn 0°" in line
            before = feed_recorded(rig, path)
        watch.wait_for_line("no pose for ", PATIENCE_S)
        with running_node(ros_domain) as node, Rig(ros_domain) as rig:
            node.wait_for_line("Subscribed", COMPILE_S)
            rig.wait_until_matched()
            feed_until(rig, watch, "the odometry began anew")
            after = feed_recorded(rig, path)
        assert watch.stop() == 0
        recorded = recorded_stamps_ns(path)
        last = f"{len(recorded)} poses, path 0.0 m; {len(recorded)} poses in {path}"
        assert watch.lines[-1] == last
    # none is missing from when the watch was matched
    assert recorded[recorded.index(before[0]) :][:10] == before
    assert recorded[-10:] == after
