"""What the mapping node refuses, and what it says where nothing comes; over real DDS."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from rgbd_glue_ros.experiments.demo.node_process import NodeProcess, private_domain, ros_environment
from rgbd_glue_ros.live.topics import KEYFRAME_EDGES, KEYFRAME_FRAME, KEYFRAME_POSE, POSE
from rgbd_glue_ros.parameters import Config, NodeConfig, parameters
from rgbd_glue_ros.slam.map_file import write_map

pytest.importorskip("rclpy", reason="ROS is not installed")
pytest.importorskip("gtsam", reason="GTSAM is not installed")
pytest.importorskip("pyhbst", reason="pyHBST is not installed")

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.parameter_client import AsyncParameterClient
from rclpy.publisher import Publisher
from rigs.faults import rig_environment, rig_node, shown
from rigs.maps import map_of
from rigs.refusal import refusal
from rigs.ros import PATIENCE_S, START_S, Rig, corner_frame

from rgbd_glue_ros.node import mapping

NODE_NAME = "rgbd_mapping"
MODULE = "rgbd_glue_ros.node.mapping"


@dataclass
class Running:
    """A node with default parameters that many tests share; no keyframe comes."""

    node: NodeProcess
    rig: Rig


@pytest.fixture(scope="module")
def running() -> Iterator[Running]:
    with (
        private_domain() as domain,
        shown(NodeProcess({}, ros_environment(domain), module=MODULE)) as node,
        Rig(domain) as rig,
    ):
        node.wait_for_line("Subscribed", START_S)
        yield Running(node, rig)
        assert node.is_running
        assert not [line for line in node.lines if "Traceback" in line]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("map_frame_id", "world"),
        ("map_file", "room.rgbdmap"),
        ("localize_only", True),
        ("sync_queue_size", 20),
        ("glue.k", 4.0),
        ("odometry.min_pixels", 100),
        ("graph_file", "other.g2o"),
    ],
)
def test_changes_of_fixed_parameters_of_the_mapping_node_are_refused_with_the_reason(
    running: Running, name: str, value: object
) -> None:
    reason = running.rig.set_parameter(NODE_NAME, name, value)
    assert reason == (
        f"{name} cannot change while the node runs: it is read once, when the node starts"
    )


def test_only_the_map_file_parameter_is_described_as_changeable(running: Running) -> None:
    names = [p.name for part in (NodeConfig(), Config()) for p in parameters(part)]
    client = AsyncParameterClient(running.rig.node, NODE_NAME)
    running.rig.wait(client.services_are_ready, "the parameter services")
    described = client.describe_parameters(names)
    running.rig.wait(described.done, "the descriptions")
    assert [
        descriptor.name
        for descriptor in described.result().descriptors
        if "Cannot change" not in descriptor.additional_constraints
    ] == ["save_map_file"]


@pytest.mark.parametrize("file", ["", "/", "~nobodyhere/room.rgbdmap", "/dev/null/room.rgbdmap"])
def test_a_map_that_cannot_be_saved_is_reported_in_one_line(running: Running, file: str) -> None:
    assert not running.rig.set_parameter(NODE_NAME, "save_map_file", file)
    answer = running.rig.trigger(f"/{NODE_NAME}/save_map")
    assert not answer.success
    assert answer.message.startswith("save_map_file: ")
    line = running.node.wait_for_line(f"Saving the map: {answer.message}", PATIENCE_S)
    assert line.startswith("[ERROR]")


def test_a_map_without_a_keyframe_is_not_saved(running: Running, tmp_path: Path) -> None:
    file = tmp_path / "room.rgbdmap"
    assert not running.rig.set_parameter(NODE_NAME, "save_map_file", str(file))
    answer = running.rig.trigger(f"/{NODE_NAME}/save_map")
    assert not answer.success
    assert answer.message == f"{file}: there is no keyframe yet; move the camera"
    assert not file.exists()


def test_nodes_of_two_robots_with_one_home_do_not_write_the_same_files(
    ros_domain: int, tmp_path: Path
) -> None:
    environment = {**ros_environment(ros_domain), "HOME": str(tmp_path)}
    namespace = ["-r", "__ns:=/fleet/robot1"]
    with (
        shown(NodeProcess({}, environment, namespace, MODULE)) as node,
        Rig(ros_domain) as rig,
    ):
        subscribed = node.wait_for_line("Subscribed", START_S)
        assert "and if it exists /fleet/robot1/depth/camera_info; publishing" in subscribed
        answer = rig.trigger(f"/fleet/robot1/{NODE_NAME}/save_map")
        assert answer.message.startswith(f"{tmp_path}/.ros/map_fleet_robot1.rgbdmap: there is no")
    given = {"save_map_file": str(tmp_path / "told.rgbdmap")}
    with (
        shown(NodeProcess(given, environment, namespace, MODULE)) as node,
        Rig(ros_domain) as rig,
    ):
        node.wait_for_line("Subscribed", START_S)
        answer = rig.trigger(f"/fleet/robot1/{NODE_NAME}/save_map")
        assert answer.message.startswith(f"{tmp_path}/told.rgbdmap: there is no")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"map_frame_id": "odom"}, "map_frame_id: is 'odom', as odom_frame_id is, and a frame is"),
        ({"map_frame_id": "base", "frame_id": "base"}, "map_frame_id: is 'base', as frame_id is"),
        ({"map_frame_id": "/map"}, "map_frame_id: '/map' begins with a slash"),
        ({"map_frame_id": '""'}, "map_frame_id: '' is not a valid frame name; give the name of"),
        ({"map_file": '"~nobodyhere/x"'}, "map_file: ~nobodyhere has no home folder; give the wh"),
        ({"map_file": "/absent.rgbdmap"}, "/absent.rgbdmap: cannot be read"),
        ({"localize_only": True}, "localize_only: there is no map; set map_file"),
        ({"stamps": "receipt"}, "stamps: receipt gives an image another stamp in each process, so"),
    ],
)
def test_invalid_arguments_are_refused_with_exit_code_2_and_one_line(
    ros_domain: int, given: dict[str, object], said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert said in refusal(mapping.main, ros_domain, capfd, given)


def test_an_invalid_argument_ends_the_process_with_that_code_and_that_line(ros_domain: int) -> None:
    given, environment = {"map_frame_id": "odom"}, ros_environment(ros_domain)
    with shown(NodeProcess(given, environment, module=MODULE)) as node:
        node.wait_for_line("map_frame_id: is 'odom', as odom_frame_id is, and a frame", START_S)
        assert node.wait_for_end(PATIENCE_S) == 2
        assert not [line for line in node.lines if "Traceback" in line]


def test_without_tf_it_does_not_say_that_it_publishes_a_transform(ros_domain: int) -> None:
    # a guess, which needs TF, is only for the odometry node
    with rig_node(ros_domain, "mapping_without_tf", guess_frame_id="wheels") as node:
        line = node.wait_for_line("Subscribed", START_S)
        assert "TF: not available" in node.lines[0]
        assert line.endswith("; publishing /map/path only, since map -> odom needs tf2_msgs")
        assert node.stop() == 0


def test_where_odom_is_another_programs_no_transform_to_it_is_broadcast(ros_domain: int) -> None:
    pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed")
    given = {"publish_tf": False}
    with (
        shown(NodeProcess(given, ros_environment(ros_domain), module=MODULE)) as node,
        Rig(ros_domain) as rig,
    ):
        line = node.wait_for_line("Subscribed", START_S)
        assert line.endswith("; publishing /map/path only, since publish_tf is false")
        rig.wait(lambda: rig.node.count_publishers("/map/path"), "the node's publishers")
        assert not rig.node.count_publishers("/tf")
        assert node.stop() == 0


@pytest.mark.slow
@pytest.mark.parametrize("task", ["read", "features extracted of"])
def test_while_a_large_map_is_loaded_its_progress_is_logged_and_a_signal_ends_the_node(
    ros_domain: int, tmp_path: Path, task: str
) -> None:
    room, count = tmp_path / "room.rgbdmap", 200
    write_map(room, map_of(count))
    given = {"map_file": str(room)}
    environment = rig_environment(ros_domain)
    with shown(NodeProcess(given, environment, module="rigs.hasty_loading")) as node:
        line = node.wait_for_line(f"{room}: {task}", START_S)
        assert line.endswith(f" of {count} keyframes")
        assert node.stop() == 0
        assert not [line for line in node.lines if "Subscribed" in line or "Traceback" in line]


@pytest.mark.slow
def test_a_map_of_another_place_is_told_in_a_line_and_is_not_saved_where_it_cannot_change(
    ros_domain: int, tmp_path: Path
) -> None:
    room, other = tmp_path / "room.rgbdmap", tmp_path / "other.rgbdmap"
    write_map(room, map_of(2))
    given = {"map_file": str(room), "localize_only": True, "save_map_file": str(other)}
    with (
        shown(NodeProcess(given, ros_environment(ros_domain), module=MODULE)) as node,
        Rig(ros_domain) as rig,
    ):
        node.wait_for_line("Subscribed", START_S)
        poses, edges = keyframe_publishers(rig)
        numbers: list[int] = []

        def is_told() -> bool:
            publish_keyframe(rig, poses.publish, edges.publish, numbers)
            return any("keyframes were compared with the 2 keyf" in line for line in node.lines)

        rig.wait(is_told, "the line")
        answer = rig.trigger(f"/{NODE_NAME}/save_map")
        assert not answer.success
        assert answer.message == (
            "localize_only: is true, so the map does not change and there is nothing to save; it "
            f"is in {room}; to add to it, start without localize_only"
        )
        assert not other.exists()
        assert node.stop() == 0
        assert any("there was nothing to save" in line for line in node.lines)


@pytest.mark.slow
def test_keyframes_that_wait_for_a_known_place_are_in_diagnostics_answer_and_last_line(
    ros_domain: int, tmp_path: Path
) -> None:
    room, other = tmp_path / "room.rgbdmap", tmp_path / "other.rgbdmap"
    write_map(room, map_of(2))
    given = {"map_file": str(room), "save_map_file": str(other)}
    with (
        shown(NodeProcess(given, ros_environment(ros_domain), module=MODULE)) as node,
        Rig(ros_domain) as rig,
    ):
        node.wait_for_line("Subscribed", START_S)
        poses, edges = keyframe_publishers(rig)
        numbers: list[int] = []

        def waiting() -> str:
            publish_keyframe(rig, poses.publish, edges.publish, numbers)
            statuses = [status for array in rig.diagnostics for status in array.status]
            values = {item.key: item.value for status in statuses for item in status.values}
            return str(values.get("waiting_for_known_place", ""))

        rig.wait(lambda: waiting() not in {"", "0"}, "diagnostics")
        answer = rig.trigger(f"/{NODE_NAME}/save_map")
        assert answer.success
        assert answer.message.startswith(f"{other}: 2 keyframes; without ")
        assert answer.message.endswith("that show no known place of it yet")
        assert node.stop() == 0
        (line,) = [line for line in node.lines if "Map: 2 keyframes" in line]
        assert f"nothing was added to {room}, so there was nothing to save; " in line
        assert line.endswith(f"that show no known place of {room}")


def test_a_damaged_map_is_refused_with_exit_code_2_and_one_line(
    ros_domain: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    room = tmp_path / "room.rgbdmap"
    room.write_text("no map")
    given: dict[str, object] = {"map_file": str(room)}
    assert f"{room}: holds no valid map" in refusal(mapping.main, ros_domain, capfd, given)


def keyframe_publishers(rig: Rig) -> tuple[Publisher, Publisher]:
    """Those of poses and edges, once the node has subscribed to them and to the images."""
    poses = rig.publisher(PoseStamped, KEYFRAME_POSE)
    edges = rig.publisher(OdometryMessage, KEYFRAME_EDGES)
    publishers = (rig.color, rig.depth, rig.info, poses, edges)
    rig.wait(lambda: all(p.get_subscription_count() for p in publishers), "subscriptions")
    return poses, edges


def publish_keyframe(
    rig: Rig,
    publish_pose: Callable[[PoseStamped], None],
    publish_edge: Callable[[OdometryMessage], None],
    numbers: list[int],
    *,
    has_stamp: bool = True,
) -> None:
    """The next keyframe after ``numbers`` with its edge and image, as of a camera at rest."""
    now = rig.node.get_clock().now()
    pose, edge = PoseStamped(), OdometryMessage()
    pose.header.stamp = edge.header.stamp = now.to_msg()
    number = len(numbers)
    edge.header.frame_id = KEYFRAME_FRAME.format(number - 1)
    edge.child_frame_id = KEYFRAME_FRAME.format(number)
    edge.pose.covariance = np.eye(6).ravel()
    pose.pose.orientation.w = edge.pose.pose.orientation.w = 1.0
    publish_pose(pose)
    if numbers:
        publish_edge(edge)
    numbers.append(number)
    rig.publish(corner_frame(now.nanoseconds if has_stamp else 0))
    rig.spin_for(0.05)


@pytest.mark.slow
def test_keyframes_of_images_without_a_stamp_are_skipped_and_the_reason_is_logged_once(
    ros_domain: int,
) -> None:
    with shown(NodeProcess({}, ros_environment(ros_domain), module=MODULE)) as node:
        node.wait_for_line("Subscribed", START_S)
        with Rig(ros_domain) as rig:
            poses, edges = keyframe_publishers(rig)

            def publish_until(line: str) -> bool:
                publish_keyframe(rig, poses.publish, edges.publish, numbers, has_stamp=False)
                return any(line in said for said in node.lines)

            numbers: list[int] = []
            why = "no image has its stamp, so it is skipped; images have no stamp"
            rig.wait(lambda: publish_until(why), "the reason")
            rig.wait(lambda: publish_until("") and len(numbers) > 20, "more keyframes")
        assert len([said for said in node.lines if why in said]) == 1
        assert node.is_running
        assert not [line for line in node.lines if "Traceback" in line]


@pytest.mark.slow
def test_a_mapping_node_that_is_started_late_says_once_how_many_keyframes_it_has_not_got(
    ros_domain: int,
) -> None:
    with shown(NodeProcess({}, ros_environment(ros_domain), module=MODULE)) as node:
        node.wait_for_line("Subscribed", START_S)
        with Rig(ros_domain) as rig:
            poses, edges = keyframe_publishers(rig)
            numbers = [*range(12)]

            def is_told() -> bool:
                publish_keyframe(rig, poses.publish, edges.publish, numbers)
                return any("without 12 earlier ones" in line for line in node.lines)

            rig.wait(is_told, "the line")
            for _ in range(3):
                is_told()
        (line,) = [line for line in node.lines if "earlier one" in line]
        assert line.startswith("[WARN]")
        # by its full name, unless the first message comes before the name of its publisher
        assert "or call /rig/reset_odom" in line or "or call its service ~/reset_odom" in line


@pytest.mark.slow
def test_missing_topics_are_named_one_by_one_until_messages_arrive(ros_domain: int) -> None:
    with rig_node(ros_domain, "hasty_mapping") as node:
        nobody = node.wait_for_line("No frame for 1 s", START_S)
        for topic in ("/rgb/image (color)", "/depth/image (depth)", "/rgb/camera_info"):
            assert topic in nobody
        assert "color and depth and camera_info are missing: start the camera" in nobody
        missing = "No keyframes: /pose, /keyframe/pose and /keyframe/edges have no publisher"
        node.wait_for_line(missing, PATIENCE_S)
        assert not [line for line in node.lines if "WARN" in line and "No " in line]
        with Rig(ros_domain) as rig:
            poses = rig.publisher(PoseStamped, POSE)
            rig.publisher(PoseStamped, KEYFRAME_POSE)
            rig.publisher(OdometryMessage, KEYFRAME_EDGES)
            by = "arrived from /rig (geometry_msgs/msg/PoseStamped, reliable)"

            def logs(line: str) -> bool:
                return any(line in said for said in node.lines)

            rig.wait(lambda: logs(f"no message on /pose {by}: the odometry has no pose"), "a look")
            rig.wait(lambda: logs("/rgb/image (color) from /rig"), "a look at images")

            def publish_until(line: str) -> bool:
                rig.publish(corner_frame(rig.node.get_clock().now().nanoseconds))
                poses.publish(PoseStamped())
                return logs(line)

            at_rest = f"no message on /keyframe/pose {by}: the odometry creates them only where"
            rig.wait(lambda: publish_until(at_rest), "a look at keyframes")
            assert "ros2 service call /rig/reset_odom std_srvs" in node.wait_for_line(at_rest, 0)
            rig.wait(lambda: logs("No more keyframes: the last of "), "a look after the last pose")
            line = node.wait_for_line("No more keyframes: the last of ", PATIENCE_S)
            assert "on /pose from /rig (geometry_msgs/msg/PoseStamped, reliable)" in line
            assert line.endswith("the odometry has no pose any more; its log says why")
        for line in (missing, "no message on /pose", at_rest):
            assert len([said for said in node.lines if line in said]) == 1


@pytest.mark.slow
def test_images_of_two_clocks_are_told_with_what_the_mapping_node_can_do(ros_domain: int) -> None:
    with rig_node(ros_domain, "hasty_mapping") as node:
        node.wait_for_line("Subscribed", START_S)
        with Rig(ros_domain) as rig:
            publishers = (rig.color, rig.depth, rig.info)
            rig.wait(lambda: all(p.get_subscription_count() for p in publishers), "subscriptions")

            def publish_until(line: str) -> bool:
                now = rig.node.get_clock().now().nanoseconds
                rig.publish(replace(corner_frame(now), depth_delay_ns=3600 * 10**9))
                rig.spin_for(0.05)
                return any(line in said for said in node.lines)

            rig.wait(lambda: publish_until("they come from two clocks"), "the diagnosis")
        (line,) = [said for said in node.lines if "they come from two clocks" in said]
        assert (
            "make the driver stamp both with one clock, or record them and map the recording"
            in line
        )
        assert "(rgbd-glue map RECORDING --set stamps=receipt)" in line
        # which it refuses
        assert "stamps:=receipt" not in line


@pytest.mark.slow
def test_keyframes_whose_edges_are_lost_are_told_in_a_line(ros_domain: int) -> None:
    with shown(NodeProcess({}, ros_environment(ros_domain), module=MODULE)) as node:
        node.wait_for_line("Subscribed", START_S)
        with Rig(ros_domain) as rig:
            poses = rig.publisher(PoseStamped, KEYFRAME_POSE)
            rig.wait(lambda: poses.get_subscription_count() > 1, "the subscription")
            lost = "keyframe/edges: the edge of the keyframe at 1.000000000 s did not come"

            def publish_until(line: str) -> bool:
                pose = PoseStamped()
                numbers.append(len(numbers) + 1)
                pose.header.stamp.sec = numbers[-1]
                pose.pose.orientation.w = 1.0
                poses.publish(pose)
                rig.spin_for(0.02)
                return any(line in said for said in node.lines)

            numbers: list[int] = []
            rig.wait(lambda: publish_until(lost), "the line")
            for _ in range(20):
                publish_until("")
        assert len([said for said in node.lines if "did not come" in said]) == 1
        assert node.is_running
