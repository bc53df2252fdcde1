"""The mapping node over real DDS: drift comes in, map -> odom and a corrected path come out."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from enum import Enum
from itertools import count
from pathlib import Path as FilePath

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames
from rigs.drifted import CHANGED, Drifted, config, drifted, rmse

from rgbd_glue_ros.experiments.demo.node_process import NodeProcess, ros_environment
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.keyframe_edges import start_message
from rgbd_glue_ros.live.topics import (
    KEYFRAME_EDGES,
    KEYFRAME_FRAME,
    KEYFRAME_POSE,
    MAP_PATH,
    POSE,
)
from rgbd_glue_ros.messages import making
from rgbd_glue_ros.messages.making import copy_fields
from rgbd_glue_ros.messages.poses import parse_pose, pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.slam.live_map import LiveMap, PublishedKeyframe
from rgbd_glue_ros.slam.map_file import read_map, write_map
from rgbd_glue_ros.types import NANOSECONDS, Float64, PoseGraphEdge

pytest.importorskip("rclpy", reason="ROS is not installed")
pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed (scripts/tf2-msgs builds it)")
pytest.importorskip("gtsam", reason="GTSAM is not installed")
pytest.importorskip("pyhbst", reason="pyHBST is not installed")

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMessage
from nav_msgs.msg import Path
from rclpy.qos import ReliabilityPolicy
from rigs.faults import rig_environment
from rigs.refusal import refusal
from rigs.ros import OPTICAL_FRAME, START_S, frame_messages
from rigs.slow_map_writer import PIPE
from rigs.tf import Robot, transform
from std_srvs.srv import Trigger

from rgbd_glue_ros.node import mapping
from rgbd_glue_ros.node.keyframe_matching import KEYFRAMES_WAITING

NODE_NAME = "rgbd_mapping"
MODULE = "rgbd_glue_ros.node.mapping"
MAPPED_S = 60.0


def pose_message(T: Float64, at_ns: int) -> PoseStamped:
    return copy_fields(making.pose_stamped(T, making.header(at_ns, "odom")), PoseStamped())


def edge_message(edge: PoseGraphEdge, at_ns: int) -> OdometryMessage:
    message = OdometryMessage(child_frame_id=KEYFRAME_FRAME.format(edge.child))
    head = making.header(at_ns, KEYFRAME_FRAME.format(edge.parent))
    stamped = copy_fields(making.pose_stamped(edge.T_parent_child, head), PoseStamped())
    message.header, message.pose.pose = stamped.header, stamped.pose
    covariance = se3.pose_covariance(edge.T_parent_child, edge.covariance)
    message.pose.covariance = covariance.ravel()
    return message


class Images(Enum):
    """What becomes of those of a keyframe."""

    WHOLE = "they come"
    LOST = "they do not come"
    USELESS = "nobody can tell what they show"


class Session:
    """A robot whose odometry is known, beside a mapping node."""

    def __init__(self, robot: Robot, node: NodeProcess) -> None:
        self._robot = robot
        self._node = node
        self.paths: list[Path] = []
        robot.node.create_subscription(Path, MAP_PATH, self.paths.append, 10)
        self._poses = robot.publisher(PoseStamped, KEYFRAME_POSE)
        self._edges = robot.publisher(OdometryMessage, KEYFRAME_EDGES)
        self._tracked = robot.publisher(PoseStamped, POSE)
        node.wait_for_line("Subscribed", START_S)
        robot.wait(self._is_matched, "the node's subscriptions", START_S)

    def _is_matched(self) -> bool:
        images = (self._robot.color, self._robot.depth, self._robot.info)
        for publisher in images:
            listeners = self._robot.node.get_subscriptions_info_by_topic(publisher.topic_name)
            if {i.qos_profile.reliability for i in listeners} != {ReliabilityPolicy.RELIABLE}:
                return False
        publishers = (*images, self._poses, self._edges, self._tracked)
        taken = [publisher.get_subscription_count() for publisher in publishers]
        return min(taken) > 0 and bool(self._robot.node.count_publishers(MAP_PATH))

    def begin(self, T_odom_camera: Float64, at_ns: int) -> None:
        """The odometry begins with a keyframe."""
        start = start_message(T_odom_camera, 1e-6 * np.eye(6), at_ns, "odom")
        self._edges.publish(copy_fields(start, OdometryMessage()))

    def measure(self, edge: PoseGraphEdge, at_ns: int) -> None:
        """An edge of a keyframe that was published before."""
        self._edges.publish(edge_message(edge, at_ns))

    def track(self, T_odom_camera: Float64, at_ns: int) -> None:
        """The pose of a frame."""
        self._tracked.publish(pose_message(T_odom_camera, at_ns))

    def publish(
        self,
        keyframe: Drifted,
        T_odom_camera: Float64,
        *,
        images: Images = Images.WHOLE,
        later_ns: int = 0,
        camera_frame: str = OPTICAL_FRAME,
    ) -> None:
        """A keyframe with its edges: its images come last."""
        frame = recorded_frames()[keyframe.row]
        frame = replace(frame, stamp_ns=frame.stamp_ns + later_ns, frame_id=camera_frame)
        self._poses.publish(pose_message(T_odom_camera, frame.stamp_ns))
        for edge in keyframe.edges:
            self._edges.publish(edge_message(edge, frame.stamp_ns))
        messages = frame_messages(frame, is_compressed=False)
        if images is Images.USELESS:
            messages.color.encoding = "of nobody"
        if images is not Images.LOST:
            self._robot.send(messages)

    def map_as_tracked(self, keyframes: Sequence[Drifted]) -> None:
        """Publishes keyframes without drift, and waits until they are mapped."""
        for keyframe in keyframes:
            self.publish(keyframe, keyframe.keyframe.T_odom_camera)
        self.wait_for_path_of(len(keyframes))

    def map_with_drift(self, keyframes: Sequence[Drifted]) -> None:
        """Publishes a graph of keyframes where drift has them, and waits until they are mapped."""
        first = keyframes[0]
        self.begin(first.T_odom_camera, recorded_frames()[first.row].stamp_ns)
        for keyframe in keyframes:
            self.publish(keyframe, keyframe.T_odom_camera)
        self.wait_for_path_of(len(keyframes))

    def rest(self, keyframe: Drifted, later_ns: int) -> None:
        """A later frame with a pose, which is no keyframe."""
        frame = recorded_frames()[keyframe.row]
        frame = replace(frame, stamp_ns=frame.stamp_ns + later_ns)
        self._robot.heard.clear()
        self._robot.send(frame_messages(frame, is_compressed=False))
        self.wait_for_map_odom(keyframe.T_odom_camera, frame.stamp_ns)

    def wait_for_path_of(self, count: int) -> None:
        """Waits until the map has so many keyframes."""
        self._robot.wait(
            lambda: self.paths and len(self.paths[-1].poses) == count,
            f"the path with {count} keyframes",
            MAPPED_S,
        )

    def wait_for_map_odom(self, T_odom_camera: Float64, at_ns: int) -> Float64:
        """T_map_odom [4, 4] as it is published at a pose."""
        self._robot.heard.clear()
        self.track(T_odom_camera, at_ns)
        self._robot.wait(lambda: self._robot.heard, "map -> odom")
        heard = self._robot.heard[-1]
        assert (heard.header.frame_id, heard.child_frame_id) == ("map", "odom")
        assert stamp_ns(heard.header.stamp) == at_ns
        return pose_from_message(heard, "/tf")

    def save(self) -> str:
        """Calls ~/save_map and returns what it says."""
        response = self._robot.trigger(f"/{NODE_NAME}/save_map")
        assert response.success, response.message
        return str(response.message)


@pytest.mark.slow
@pytest.mark.every_python
def test_drift_is_corrected_in_the_map_and_odom_stays_unchanged(ros_domain: int) -> None:
    keyframes = drifted()
    frames = recorded_frames()
    with (
        NodeProcess(CHANGED, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        for number, keyframe in enumerate(keyframes):
            session.publish(keyframe, keyframe.T_odom_camera)
            if number:
                session.wait_for_path_of(number + 1)
        last = keyframes[-1]
        at_ns = frames[last.row].stamp_ns
        T_map_odom = session.wait_for_map_odom(last.T_odom_camera, at_ns)
        robot.diagnostics.clear()
        robot.wait(lambda: robot.diagnostics, "diagnostics")
        sys.stdout.write("\n".join(node.lines))

    (status,) = robot.diagnostics[-1].status
    assert (status.name, status.level) == ("/rgbd_mapping: mapping", DiagnosticStatus.OK)
    values = {item.key: item.value for item in status.values}
    assert (values["is_placed"], values["waiting"]) == ("true", "0")
    assert values["keyframes"] == str(len(keyframes))
    assert int(values["loops"]) >= 3
    assert 0 <= float(values["since_last_keyframe_s"]) < MAPPED_S
    path = session.paths[-1]
    assert path.header.frame_id == "map"
    assert [stamp_ns(p.header.stamp) for p in path.poses] == [
        frames[keyframe.row].stamp_ns for keyframe in keyframes
    ]
    truth = np.array([keyframe.T_true for keyframe in keyframes])
    before = rmse(np.array([keyframe.T_odom_camera for keyframe in keyframes]), truth)
    found = np.array([pose_from_message(p, MAP_PATH) for p in path.poses])
    assert rmse(found, truth) < 0.25 * before
    assert se3.difference(T_map_odom, np.eye(4)) > 0.02
    np.testing.assert_allclose(T_map_odom @ last.T_odom_camera, found[-1], atol=1e-6)


@pytest.mark.slow
def test_a_node_starts_with_a_saved_map_and_localises_odom_in_it(
    ros_domain: int, tmp_path: FilePath
) -> None:
    keyframes, room = drifted()[:4], tmp_path / "new" / "room.rgbdmap"
    saving = {**CHANGED, "save_map_file": str(tmp_path / "before.rgbdmap")}
    with (
        NodeProcess(saving, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        session.map_as_tracked(keyframes)
        assert not robot.set_parameter(NODE_NAME, "save_map_file", str(room))
        assert session.save() == f"{room}: {len(keyframes)} keyframes"
    assert not (tmp_path / "before.rgbdmap").exists()

    # odometry starts elsewhere the next time
    T_start = se3.exp(np.array([0.4, 0.2, -0.1, 0.1, 0.2, -0.3]))
    given = {**CHANGED, "map_file": str(room), "localize_only": True}
    with (
        NodeProcess(given, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        robot.wait(lambda: robot.diagnostics, "diagnostics")
        assert robot.diagnostics[0].status[0].message.startswith("no place of the map has been")
        for keyframe in keyframes[:2]:
            T_odom_camera = se3.inverse(T_start) @ keyframe.keyframe.T_odom_camera
            session.publish(keyframe, T_odom_camera)
        node.wait_for_line("shows a known place", MAPPED_S)
        robot.diagnostics.clear()
        robot.wait(lambda: robot.diagnostics, "diagnostics")
        assert robot.diagnostics[-1].status[0].level == DiagnosticStatus.OK
        at_ns = recorded_frames()[keyframes[1].row].stamp_ns
        T_map_odom = session.wait_for_map_odom(T_odom_camera, at_ns)
    assert se3.difference(T_map_odom, T_start) < 0.03


@pytest.mark.slow
def test_a_late_edge_corrects_path_and_map_odom_without_another_keyframe(ros_domain: int) -> None:
    keyframes = drifted()[:3]
    with (
        NodeProcess(CHANGED, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        session.map_with_drift(keyframes)
        before = pose_from_message(session.paths[-1].poses[-1], MAP_PATH)
        session.paths.clear()
        at_ns = recorded_frames()[keyframes[-1].row].stamp_ns
        T = before @ se3.exp(np.array([0.02, 0, 0, 0, 0, 0]))
        session.measure(PoseGraphEdge(0, 2, T, 1e-8 * np.eye(6)), at_ns)
        session.wait_for_path_of(len(keyframes))
        after = pose_from_message(session.paths[-1].poses[-1], MAP_PATH)
        assert stamp_ns(session.paths[-1].header.stamp) == at_ns
        newest = keyframes[-1].T_odom_camera
        T_map_odom = session.wait_for_map_odom(newest, at_ns)
    assert se3.difference(before, after) > 0.01
    np.testing.assert_allclose(T_map_odom @ newest, after, atol=1e-6)


@pytest.mark.slow
def test_once_the_odometry_begins_anew_map_odom_is_unknown_until_its_first_keyframe_is_recognised(
    ros_domain: int, tmp_path: FilePath
) -> None:
    keyframes, room = drifted()[:3], tmp_path / "room.rgbdmap"
    live_map = LiveMap(config())
    for number, keyframe in enumerate(keyframes):
        frame = recorded_frames()[keyframe.row]
        T = keyframe.keyframe.T_odom_camera
        live_map.add(number, PublishedKeyframe(frame, T, keyframe.edges))
    write_map(room, live_map.saved())
    # both are numbered from 0
    first, other = (replace(keyframe, edges=()) for keyframe in keyframes[::2])
    T_start = other.keyframe.T_odom_camera
    at_ns = recorded_frames()[first.row].stamp_ns
    begun_ns = recorded_frames()[other.row].stamp_ns + 10 * NANOSECONDS
    given = {**CHANGED, "map_file": str(room), "localize_only": True}
    with (
        NodeProcess(given, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):

        def recognised() -> int:
            return len([line for line in node.lines if "Keyframe 0 shows a known place" in line])

        session = Session(robot, node)
        session.begin(np.eye(4), at_ns)
        # the camera stands still: there is no second keyframe
        session.publish(first, np.eye(4))
        robot.wait(lambda: recognised() == 1, "a known place", MAPPED_S)
        before = session.wait_for_map_odom(np.eye(4), at_ns)
        robot.heard.clear()
        session.begin(np.eye(4), begun_ns)
        session.track(np.eye(4), begun_ns)
        node.wait_for_line("map -> odom is unknown until a place of", START_S)
        session.track(np.eye(4), begun_ns + 1)
        session.publish(other, np.eye(4), later_ns=10 * NANOSECONDS)
        # after a gap, images are matched once the next have come
        after_ns = begun_ns + NANOSECONDS // 30
        next_frame = replace(recorded_frames()[other.row], stamp_ns=after_ns)
        robot.send(frame_messages(next_frame, is_compressed=False))
        robot.wait(lambda: recognised() == 2, "a known place", MAPPED_S)
        session.track(np.eye(4), after_ns)
        robot.wait(lambda: robot.heard, "map -> odom")
        (heard,) = robot.heard
        assert stamp_ns(heard.header.stamp) == after_ns
        after = pose_from_message(heard, "/tf")
    assert se3.difference(before, np.eye(4)) < 0.03
    assert se3.difference(after, T_start) < 0.03
    assert se3.difference(before, after) > 0.06


@pytest.mark.slow
def test_when_a_bag_restarts_nothing_waits_for_images_from_before(
    ros_domain: int, tmp_path: FilePath
) -> None:
    *keyframes, without_images = drifted()[:6]
    given = {**CHANGED, "save_map_file": str(tmp_path / "room.rgbdmap")}
    with (
        NodeProcess(given, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        session.map_with_drift(keyframes)
        session.publish(without_images, without_images.T_odom_camera, images=Images.LOST)
        session.save()  # which is answered once the keyframe has been received
        session.map_with_drift(keyframes[:2])
    stamps = [recorded_frames()[keyframe.row].stamp_ns for keyframe in keyframes[:2]]
    assert [stamp_ns(pose.header.stamp) for pose in session.paths[-1].poses] == stamps


@pytest.mark.slow
def test_a_map_that_an_odometry_begun_anew_replaces_is_said_to_go_and_its_file_is_kept(
    ros_domain: int, tmp_path: FilePath
) -> None:
    keyframes, room = drifted()[:4], tmp_path / "room.rgbdmap"
    given = {**CHANGED, "save_map_file": str(room)}
    with (
        NodeProcess(given, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        session.map_with_drift(keyframes[:3])
        session.save()
        session.map_with_drift(keyframes)
        session.map_with_drift(keyframes[:2])
        line = node.wait_for_line("4 keyframes of the map are dropped", START_S)
        assert line.startswith("[WARN]")
        assert session.save().endswith(f"is kept as {room}.bak")
        assert len([line for line in node.lines if "are dropped" in line]) == 2
    assert (len(read_map(room)), len(read_map(tmp_path / "room.rgbdmap.bak"))) == (2, 3)


@pytest.mark.slow
def test_a_new_map_starts_even_if_the_first_image_of_the_new_graph_is_missing(
    ros_domain: int,
) -> None:
    before, rows = drifted()[:3], drifted()[3:6]
    # numbered from 0 again
    first, *after = [replace(new, edges=old.edges) for new, old in zip(rows, before, strict=True)]
    with (
        NodeProcess(CHANGED, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        session.map_with_drift(before)
        session.publish(first, first.T_odom_camera, images=Images.LOST)
        for keyframe in after:
            session.publish(keyframe, keyframe.T_odom_camera)
        node.wait_for_line("no image has its stamp, so it is skipped", MAPPED_S)
        session.wait_for_path_of(len(after))
    stamps = [recorded_frames()[keyframe.row].stamp_ns for keyframe in after]
    assert [stamp_ns(pose.header.stamp) for pose in session.paths[-1].poses] == stamps


@pytest.mark.slow
def test_images_of_keyframes_have_the_size_of_those_in_the_odometry(
    ros_domain: int, tmp_path: FilePath
) -> None:
    keyframes, room = drifted()[:2], tmp_path / "room.rgbdmap"
    width = recorded_frames()[0].intrinsics.width // 2
    given = {**CHANGED, "max_width": width, "save_map_file": str(room)}
    with (
        NodeProcess(given, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        session.map_as_tracked(keyframes)
        session.save()
    assert [view.rest.intrinsics.width for view in read_map(room).views] == [width, width]


@pytest.mark.slow
def test_keyframes_with_lost_or_unusable_images_neither_affect_others_nor_restart_the_map(
    ros_domain: int,
) -> None:
    keyframes, bad = drifted()[:6], {1: Images.LOST, 3: Images.USELESS, 4: Images.LOST}
    with (
        NodeProcess(CHANGED, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        for number, keyframe in enumerate(keyframes):
            images = bad.get(number, Images.WHOLE)
            session.publish(keyframe, keyframe.T_odom_camera, images=images)
        session.wait_for_path_of(3)
        node.wait_for_line("no image has its stamp, so it is skipped", START_S)
        node.wait_for_line("of nobody", START_S)
        first = session.paths[-1]
        # after a reset, with the first keyframe of the new graph lost
        for number, keyframe in enumerate(keyframes[:4]):
            images = Images.WHOLE if number else Images.LOST
            session.publish(keyframe, keyframe.T_odom_camera, images=images, later_ns=10**10)
        stamps = [recorded_frames()[k.row].stamp_ns + 10**10 for k in keyframes[1:4]]
        robot.wait(
            lambda: [stamp_ns(p.header.stamp) for p in session.paths[-1].poses] == stamps,
            "the path of the new graph",
            MAPPED_S,
        )
        assert not [line for line in node.lines if "Traceback" in line or "could not" in line]
    kept = [keyframe for number, keyframe in enumerate(keyframes) if number not in bad]
    found = np.array([pose_from_message(p, MAP_PATH) for p in first.poses])
    for T, keyframe in zip(found, kept, strict=True):
        assert se3.difference(T, keyframe.T_odom_camera) < 0.05


@pytest.mark.slow
def test_each_invalid_edge_is_logged_in_one_line_and_so_is_a_second_mapper(
    ros_domain: int,
) -> None:
    good, frame = PoseGraphEdge(0, 1, np.eye(4), 1e-4 * np.eye(6)), recorded_frames()[0]
    hostile = []
    for parent, child, covariance in (
        ("\x1b[2J", "keyframe_1", np.eye(6)),
        ("keyframe_0", "keyframe_" + "9" * 5000, np.eye(6)),
        ("keyframe_0", "keyframe_1", np.full((6, 6), np.nan)),
        ("keyframe_0", "keyframe_1", -np.eye(6)),
    ):
        message = edge_message(good, frame.stamp_ns)
        message.header.frame_id, message.child_frame_id = parent, child
        message.pose.covariance = covariance.ravel()
        hostile.append(message)
    environment = ros_environment(ros_domain)
    with (
        NodeProcess({}, environment, module=MODULE) as node,
        NodeProcess({}, environment, module=MODULE),
        Robot(ros_domain) as robot,
    ):
        edges = robot.publisher(OdometryMessage, KEYFRAME_EDGES)
        # one of them could be the other node's
        robot.wait(lambda: edges.get_subscription_count() == 2, "both subscriptions", START_S)
        for message in hostile:
            edges.publish(message)
        node.wait_for_line("a covariance is not positive definite", START_S)
        node.wait_for_line("/rgbd_mapping is also the name of 1 other", START_S)
        assert len([line for line in node.lines if "is no keyframe" in line]) == 2
        assert all(line.startswith("[") for line in node.lines)


@pytest.mark.slow
def test_while_a_map_is_being_written_map_odom_is_published(
    ros_domain: int, tmp_path: FilePath
) -> None:
    keyframes, pipe, room = drifted()[:2], tmp_path / "pipe", tmp_path / "room.rgbdmap"
    os.mkfifo(pipe)
    environment = {**rig_environment(ros_domain), PIPE: str(pipe)}
    given = {**CHANGED, "save_map_file": str(room)}
    with (
        NodeProcess(given, environment, module="rigs.slow_map_writer") as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        session.map_as_tracked(keyframes)
        client = robot.node.create_client(Trigger, f"/{NODE_NAME}/save_map")
        robot.wait(client.service_is_ready, "the service")
        answer = client.call_async(Trigger.Request())
        robot.wait(lambda: "writing the map" in node.lines, "the call")
        for at_ns in range(3):
            session.wait_for_map_odom(np.eye(4), 10**18 + at_ns)
        assert not answer.done()
        pipe.write_bytes(b"")
        robot.wait(answer.done, "the answer", MAPPED_S)
        assert answer.result().success
        assert not [line for line in node.lines if "Traceback" in line]
    assert len(read_map(room)) == len(keyframes)


@pytest.mark.slow
def test_a_call_of_save_map_does_not_keep_the_transform_away_that_a_keyframe_waits_for(
    ros_domain: int, tmp_path: FilePath
) -> None:
    keyframes = drifted()[:2]
    robot_frame = {"frame_id": "base_link", "wait_for_transform": 10.0}
    given = {**CHANGED, **robot_frame, "save_map_file": str(tmp_path / "room.rgbdmap")}
    with (
        NodeProcess(given, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        for keyframe in keyframes:
            session.publish(keyframe, keyframe.keyframe.T_odom_camera)
        # until the first of them waits
        for _ in range(5):
            answer = robot.trigger(f"/{NODE_NAME}/save_map")
            assert "there is no keyframe yet" in answer.message
        robot.tell_where_the_camera_is()
        session.wait_for_path_of(len(keyframes))
        assert not [line for line in node.lines if "no transform" in line]


@pytest.mark.slow
def test_the_first_keyframe_is_mapped_however_long_the_camera_rests_there(ros_domain: int) -> None:
    first, second = drifted()[:2]
    rest_ns = 5 * NANOSECONDS
    with (
        NodeProcess(CHANGED, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        session.publish(first, first.T_odom_camera)
        for later_ns in range(0, rest_ns, NANOSECONDS // 20):
            session.rest(first, later_ns)
        session.publish(second, second.T_odom_camera, later_ns=rest_ns)
        session.wait_for_path_of(2)
        assert not [line for line in node.lines if "no image has its stamp" in line]


@pytest.mark.slow
def test_keyframes_without_any_images_are_told_and_do_not_wait_for_ever(ros_domain: int) -> None:
    with (
        NodeProcess({}, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        session = Session(robot, node)
        keyframe, numbers = drifted()[0], count()

        def is_told() -> bool:
            number = next(numbers)
            edge = PoseGraphEdge(number, number + 1, np.eye(4), 1e-4 * np.eye(6))
            session.publish(
                replace(keyframe, edges=(edge,) if number else ()),
                np.eye(4),
                images=Images.LOST,
                later_ns=number * NANOSECONDS,
            )
            robot.spin_for(0.01)
            return any("no image has its stamp" in line for line in node.lines)

        robot.wait(is_told, "the line")
        assert next(numbers) > KEYFRAMES_WAITING


@pytest.mark.slow
def test_keyframes_of_another_camera_have_its_own_pose_on_the_robot(ros_domain: int) -> None:
    keyframes = drifted()[:2]
    given = {**CHANGED, "frame_id": "base_link", "wait_for_transform": 10.0}
    T_base_rear = parse_pose("", "-0.3 0 0.4 0 0 3")
    with (
        NodeProcess(given, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        robot.tell_where_the_camera_is()
        robot.tell(transform("base_link", "rear_camera", T_base_rear))
        session = Session(robot, node)
        for keyframe in keyframes:
            session.publish(keyframe, np.eye(4))
        session.wait_for_path_of(len(keyframes))
        for keyframe in keyframes:
            session.publish(keyframe, np.eye(4), later_ns=10**10, camera_frame="rear_camera")
        node.wait_for_line("TF: found rear_camera", MAPPED_S)
        stamps = [recorded_frames()[k.row].stamp_ns + 10**10 for k in keyframes]
        robot.wait(
            lambda: [stamp_ns(p.header.stamp) for p in session.paths[-1].poses] == stamps,
            "the path of the new graph",
            MAPPED_S,
        )
    # where the robot was, by the pose of the rear camera
    T = pose_from_message(session.paths[-1].poses[0], MAP_PATH)
    np.testing.assert_allclose(T, np.eye(4), atol=1e-3)


def test_localising_without_a_map_is_refused(
    ros_domain: int, capfd: pytest.CaptureFixture[str]
) -> None:
    said = refusal(mapping.main, ros_domain, capfd, {"localize_only": True})
    assert said.startswith("localize_only: there is no map; set map_file")
