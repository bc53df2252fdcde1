"""What the node publishes is what rtabmap, robot_localization and slam_toolbox can use.

Each is not here, so its own rule is written down and applied to real messages of a drive.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames

from rgbd_glue_ros.experiments.demo.node_process import NodeProcess, private_domain, ros_environment
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.topics import KEYFRAME_EDGES, SAVE_GRAPH_SERVICE
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.trajectories.pose_graph import GraphReader, read_graph
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraph

pytest.importorskip("rclpy", reason="ROS is not installed")
pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed (scripts/tf2-msgs builds it)")

from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Odometry as OdometryMessage
from rigs.ros import START_S
from rigs.tf import Robot

# all share one drive, which takes seconds whichever of them comes first
pytestmark = [pytest.mark.slow, pytest.mark.every_python]

FRAMES = 60
# rtabmap's number for "not known", and the one that it takes for a default that nobody set
UNKNOWN, NOBODY_SET = 9999.0, 1.0


@dataclass(frozen=True)
class Drive:
    """What a node published of the first two seconds of the bundled recording."""

    odoms: Sequence[OdometryMessage]
    keyframes: Sequence[PoseStamped]
    edges: Sequence[OdometryMessage]
    transforms: Sequence[TransformStamped]
    answer: Any
    graphs: dict[GraphReader, PoseGraph]


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Drive]:
    file = tmp_path_factory.mktemp("graph") / "keyframes.g2o"
    parameters = {
        "frame_id": "base_link",
        "camera_pose": "'0.2 0 0.5 0 0.3 0'",
        "graph_file": file,
        "odometry.keyframe_translation": 0.08,
    }
    with (
        private_domain() as domain,
        NodeProcess(parameters, ros_environment(domain)) as node,
        Robot(domain) as robot,
    ):
        node.wait_for_line("Subscribed", START_S)
        edges: list[OdometryMessage] = []
        robot.node.create_subscription(OdometryMessage, KEYFRAME_EDGES, edges.append, 10)
        robot.wait_until_matched()
        robot.wait(lambda: robot.node.count_publishers(KEYFRAME_EDGES), "the edges' publisher")
        for frame in recorded_frames()[:FRAMES]:
            robot.pose_of(frame)
        robot.wait(lambda: len(robot.odoms) == FRAMES - 1, "all odometry messages")
        robot.wait(lambda: len(robot.heard) == FRAMES, "all of /tf")
        robot.wait(lambda: len(edges) >= len(robot.keyframes), "all edges")
        name = f"/rgbd_odometry/{SAVE_GRAPH_SERVICE.removeprefix('~/')}"
        answer = robot.trigger(name)
        graphs = {reader: read_graph(path) for reader, path in _files(file).items()}
        yield Drive(robot.odoms, robot.keyframes, edges, robot.heard, answer, graphs)
        sys.stdout.write("\n".join(node.lines))


def _files(file: Path) -> dict[GraphReader, Path]:
    return {
        GraphReader.G2O: file,
        GraphReader.GTSAM: file.with_name("keyframes_gtsam.g2o"),
    }


def matrix(covariance: Any) -> Float64:
    return np.asarray(covariance, np.float64).reshape(6, 6)


def test_robot_localization_gets_frames_finite_numbers_and_a_unit_quaternion(drive: Drive) -> None:
    for odom in drive.odoms:
        assert (odom.header.frame_id, odom.child_frame_id) == ("odom", "base_link")
        q = odom.pose.pose.orientation
        assert np.linalg.norm([q.x, q.y, q.z, q.w]) == pytest.approx(1.0, abs=1e-9)
        twist = odom.twist.twist
        velocity = [getattr(v, axis) for v in (twist.linear, twist.angular) for axis in "xyz"]
        assert np.isfinite(velocity).all()
        for covariance in (odom.pose.covariance, odom.twist.covariance):
            found = matrix(covariance)
            np.testing.assert_allclose(found, found.T, atol=1e-12)
            # the filter inverts it
            assert np.linalg.eigvalsh(found).min() > 0


def test_rtabmap_gets_a_covariance_that_it_accepts_for_its_links(drive: Drive) -> None:
    """It takes the largest twist covariance since its last node, here of every ten frames."""
    for start in range(0, len(drive.odoms), 10):
        since_node = drive.odoms[start : start + 10]
        largest = max((matrix(odom.twist.covariance) for odom in since_node), key=np.trace)
        variances = np.diag(largest)
        assert (variances > 0).all()
        assert (variances < UNKNOWN).all()
        assert not (variances == NOBODY_SET).any()


def test_rtabmap_is_never_told_to_start_a_new_map(drive: Drive) -> None:
    has_moved = False
    for odom in drive.odoms:
        assert stamp_ns(odom.header.stamp) > 0
        T = pose_from_message(odom, "odom")
        assert not (has_moved and (np.eye(4) == T).all())
        has_moved |= bool((np.eye(4) != T).any())
        assert odom.pose.covariance[0] < UNKNOWN
    assert has_moved


def test_slam_toolbox_finds_a_transform_at_the_stamp_of_every_image(drive: Drive) -> None:
    at = {stamp_ns(transform.header.stamp): transform for transform in drive.transforms}
    assert set(at) == {frame.stamp_ns for frame in recorded_frames()[:FRAMES]}
    for odom in drive.odoms:
        transform = at[stamp_ns(odom.header.stamp)]
        assert (transform.header.frame_id, transform.child_frame_id) == ("odom", "base_link")
        np.testing.assert_array_equal(
            pose_from_message(transform, "/tf"), pose_from_message(odom, "odom")
        )


def test_edges_name_their_keyframes_and_agree_with_the_keyframe_poses(drive: Drive) -> None:
    poses = [pose_from_message(message, "keyframe/pose") for message in drive.keyframes]
    stamps = [stamp_ns(message.header.stamp) for message in drive.keyframes]
    assert len(poses) >= 3
    start, *edges = drive.edges
    assert (start.header.frame_id, start.child_frame_id) == ("odom", "keyframe_0")
    assert stamp_ns(start.header.stamp) == stamps[0]
    np.testing.assert_array_equal(pose_from_message(start, "keyframe/edges"), poses[0])
    assert np.linalg.eigvalsh(matrix(start.pose.covariance)).min() > 0
    children = []
    for edge in edges:
        parent, child = (
            int(name.removeprefix("keyframe_"))
            for name in (edge.header.frame_id, edge.child_frame_id)
        )
        children.append(child)
        assert parent < child
        assert stamp_ns(edge.header.stamp) == stamps[child]
        T = pose_from_message(edge, "keyframe/edges")
        assert se3.difference(T, se3.inverse(poses[parent]) @ poses[child]) < 0.01
        assert np.linalg.eigvalsh(matrix(edge.pose.covariance)).min() > 0
    assert set(children) == set(range(1, len(poses)))


def test_the_saved_graphs_for_both_solvers_match_the_published_one(drive: Drive) -> None:
    assert drive.answer.success
    assert "keyframes_gtsam.g2o (GTSAM)" in drive.answer.message
    for graph in drive.graphs.values():
        poses = [pose_from_message(message, "keyframe/pose") for message in drive.keyframes]
        np.testing.assert_allclose(graph.keyframes.poses, poses, atol=1e-9)
        for edge, message in zip(graph.edges, drive.edges[1:], strict=True):
            T = pose_from_message(message, "keyframe/edges")
            np.testing.assert_allclose(edge.T_parent_child, T, atol=1e-9)
            assert edge.origin in {EdgeOrigin.TRACKING, EdgeOrigin.REVISIT}
            np.testing.assert_allclose(
                se3.pose_covariance(T, edge.covariance),
                matrix(message.pose.covariance),
                rtol=1e-6,
                atol=1e-12,
            )
