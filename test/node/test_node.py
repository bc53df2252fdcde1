"""The node as a process, over real DDS."""

from __future__ import annotations

import itertools
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest

from rgbd_glue_ros.experiments.demo.node_process import NodeProcess, private_domain
from rgbd_glue_ros.live.extrinsics import T_BODY_OPTICAL
from rgbd_glue_ros.live.match_image import VISUAL
from rgbd_glue_ros.live.topics import MATCHES, PATH, POSE, SUBSCRIBED
from rgbd_glue_ros.messages.fields import DEPTH_UNITS_PER_METRE
from rgbd_glue_ros.messages.fields import CompressedImage as CompressedImageFields
from rgbd_glue_ros.messages.image_codecs import encode_png, quantised
from rgbd_glue_ros.messages.images import color_from_message
from rgbd_glue_ros.messages.making import camera_info, color_image, copy_fields, depth_image, header
from rgbd_glue_ros.messages.poses import parse_pose, pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.parameters import Config, NodeConfig, parameters
from rgbd_glue_ros.types import NANOSECONDS, RgbdFrame

pytest.importorskip("rclpy", reason="ROS is not installed")

from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rigs.faults import running_node
from rigs.refusal import refusal
from rigs.ros import OPTICAL_FRAME, PATIENCE_S, START_NS, START_S, Rig, corner_frame, frame_messages
from rigs.unseen import covered
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Empty

from rgbd_glue_ros.node import node as node_module

PERIOD_NS = NANOSECONDS // 30


@dataclass
class Running:
    """A node with default parameters and a camera that many tests share; time only goes on."""

    node: NodeProcess
    rig: Rig
    stamps: Iterator[int]

    def frame(self) -> RgbdFrame:
        return corner_frame(next(self.stamps))


@pytest.fixture(scope="module")
def running() -> Iterator[Running]:
    with private_domain() as domain, running_node(domain) as node, Rig(domain) as rig:
        node.wait_for_line("Subscribed", START_S)
        rig.wait_until_matched()
        yield Running(node, rig, itertools.count(1_700_000_000 * NANOSECONDS, PERIOD_NS))


def test_a_pose_has_its_images_stamp_and_the_odom_frame(running: Running) -> None:
    frame = running.frame()
    pose = running.rig.pose_of(frame)
    stamp = pose.header.stamp.sec * NANOSECONDS + pose.header.stamp.nanosec
    assert (stamp, pose.header.frame_id) == (frame.stamp_ns, "odom")


def test_the_first_line_names_all_topics(running: Running) -> None:
    line = running.node.wait_for_line("Subscribed", PATIENCE_S)
    needed, _, optional = line.partition(", and if they exist ")
    assert needed.endswith("Subscribed to /rgb/image, /depth/image, /rgb/camera_info")
    assert optional.startswith("/depth/camera_info and /imu; publishing odom -> ")


def test_without_a_robot_frame_a_level_camera_starts_upright_in_an_odom_frame_with_z_up(
    running: Running,
) -> None:
    T_odom_camera = pose_from_message(running.rig.pose_of(running.frame()), "pose")
    ahead, up, here = [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]
    np.testing.assert_allclose(T_odom_camera @ ahead, [1, 0, 0, 0], atol=2e-3)
    np.testing.assert_allclose(T_odom_camera @ up, [0, 0, 1, 0], atol=2e-3)
    np.testing.assert_allclose(T_odom_camera @ here, [0, 0, 0, 1], atol=2e-3)


def test_a_camera_at_rest_has_zero_velocity_in_its_frame_and_valid_covariances(
    running: Running,
) -> None:
    running.rig.pose_of(running.frame())
    before = len(running.rig.odoms)
    running.rig.pose_of(running.frame())
    running.rig.wait(lambda: len(running.rig.odoms) > before, "the odometry message")
    odom = running.rig.odoms[-1]
    assert (odom.header.frame_id, odom.child_frame_id) == ("odom", OPTICAL_FRAME)
    velocity = odom.twist.twist
    for part in (velocity.linear, velocity.angular):
        np.testing.assert_allclose([part.x, part.y, part.z], 0, atol=0.03)
    for covariance in (odom.pose.covariance, odom.twist.covariance):
        matrix = covariance.reshape(6, 6)
        np.testing.assert_allclose(matrix, matrix.T, atol=1e-12)
        assert np.linalg.eigvalsh(matrix).min() > -1e-12
        assert 0 < np.trace(matrix) < 100


def test_diagnostics_contain_state_rate_latency_drops_and_evidence(running: Running) -> None:
    for _ in range(2):
        running.rig.pose_of(running.frame())
    running.rig.diagnostics.clear()
    running.rig.wait(lambda: running.rig.diagnostics, "diagnostics")
    status = running.rig.diagnostics[-1].status[0]
    values = {item.key: item.value for item in status.values}
    assert (status.level, status.message) == (b"\0", "tracking")
    assert float(values["rate_hz"]) > 0
    assert 0 < float(values["latency_p50_ms"]) <= float(values["latency_p95_ms"])
    assert int(values["color: received"]) >= int(values["frames"]) > 0
    assert values["registration"] == "ok"
    assert int(values["visual_inliers"]) > 0
    assert 0 < int(values["credible_matches"]) <= int(values["geometric_matches"])
    assert float(values["sigma_m"]) >= 0
    assert "epsilon_m" in values
    assert "last_error" in values


def image(frame: RgbdFrame) -> Image:
    head = header(frame.stamp_ns, frame.frame_id)
    return copy_fields(color_image(frame.color, head), Image())


def publish_with(running: Running, color: Image, info: CameraInfo | None = None) -> None:
    """Publishes a frame with this colour image and camera info."""
    frame = running.frame()
    head = header(frame.stamp_ns, frame.frame_id)
    info = info or copy_fields(camera_info(frame.intrinsics, head), CameraInfo())
    for message, publisher in (
        (color, running.rig.color),
        (copy_fields(depth_image(frame.depth, head), Image()), running.rig.depth),
        (info, running.rig.info),
    ):
        copy_fields(head, message.header)
        publisher.publish(message)


def test_a_truncated_image_is_logged_once_and_the_next_frame_gets_its_pose(
    running: Running,
) -> None:
    color = image(running.frame())
    color.data = color.data[:100]
    for _ in range(3):
        publish_with(running, color)
        running.node.wait_for_line("data are truncated", PATIENCE_S)
        before = len(running.rig.poses)
        running.rig.pose_of(running.frame())
        assert len(running.rig.poses) == before + 1
    assert len([line for line in running.node.lines if "data are truncated" in line]) == 1


def test_an_unknown_encoding_is_logged_with_its_topic(running: Running) -> None:
    color = image(running.frame())
    color.encoding = "h264"
    publish_with(running, color)
    assert "/rgb/image" in running.node.wait_for_line("h264", PATIENCE_S)


def test_an_uncalibrated_camera_is_logged_with_the_topic_of_its_info(running: Running) -> None:
    publish_with(running, image(running.frame()), CameraInfo(width=320, height=240))
    assert "/rgb/camera_info" in running.node.wait_for_line("K is all zeros", PATIENCE_S)


def test_the_node_survives_bytes_that_are_not_a_message(running: Running) -> None:
    running.rig.color.publish(b"\x00\x01\x00\x00these bytes are no image")
    running.rig.pose_of(running.frame())


def test_a_backward_jump_in_time_restarts_and_is_logged(running: Running) -> None:
    running.rig.pose_of(running.frame())
    earlier = itertools.count(1_600_000_000 * NANOSECONDS, PERIOD_NS)
    running.rig.publish(corner_frame(next(earlier)))  # believed when the next confirms it
    pose = running.rig.pose_of(corner_frame(next(earlier)))
    np.testing.assert_allclose(pose_from_message(pose, "pose")[:3, 3], 0, atol=2e-3)
    running.node.wait_for_line("Time went back", PATIENCE_S)
    running.rig.pose_of(corner_frame(next(earlier)))
    running.rig.publish(running.frame())  # and forward again


def test_every_parameter_is_declared_with_its_description_and_range(running: Running) -> None:
    declared = {p.name: p for part in (NodeConfig(), Config()) for p in parameters(part)}
    client = AsyncParameterClient(running.rig.node, "rgbd_odometry")
    running.rig.wait(client.services_are_ready, "the parameter services")
    described = client.describe_parameters(list(declared))
    running.rig.wait(described.done, "the descriptions")
    for descriptor in described.result().descriptors:
        parameter = declared[descriptor.name]
        assert descriptor.description == parameter.description
        assert parameter.allowed in descriptor.additional_constraints
        for bounds in (*descriptor.integer_range, *descriptor.floating_point_range):
            assert parameter.minimum in (None, bounds.from_value)
            assert parameter.maximum in (None, bounds.to_value)


def set_parameter(rig: Rig, name: str, value: object) -> str:
    """Sets a parameter of the odometry; returns why that was refused, "" if it was not."""
    return rig.set_parameter("rgbd_odometry", name, value)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("features.visual", "sift", "the keyframes hold features of one kind"),
        ("odometry.keyframes", 5, "the stored keyframes were chosen by it"),
        ("frame_id", "base_link", "it is read once, when the node starts"),
        ("glue.k", 1000.0, "out of range"),
        ("glue.k", "four", "glue.k: 'four' is not of type float; give a number"),
        ("max_update_rate", None, "max_update_rate: None is not of type float"),
        ("path_poses", 3, "path_poses cannot change while the node runs"),
        ("publish_null_when_lost", 1, "publish_null_when_lost: 1 is not of type bool"),
        ("max_updaterate", 3.0, "max_updaterate: no such parameter; did you mean max_update_rate?"),
        ("reset_countdown", 3, "reset_countdown: no such parameter; did you mean odometry.reset_c"),
        ("use_sim_time", "yes", "type"),
        ("initial_pose", "1 2", "not six or seven finite numbers"),
    ],
)
def test_changes_of_fixed_parameters_are_refused_with_the_reason(
    running: Running, name: str, value: object, reason: str
) -> None:
    assert reason in set_parameter(running.rig, name, value)


def test_a_whole_number_is_a_float_where_a_live_parameter_is_one(running: Running) -> None:
    client = AsyncParameterClient(running.rig.node, "rgbd_odometry")
    for value in (40, 0.0):
        assert not set_parameter(running.rig, "max_update_rate", value)
        answer = client.get_parameters(["max_update_rate"])
        running.rig.wait(answer.done, "the value")
        (said,) = answer.result().values
        assert (parameter_value_to_python(said), said.type) == (
            value,
            ParameterType.PARAMETER_DOUBLE,
        )


@pytest.mark.slow
@pytest.mark.every_python
def test_changes_of_live_parameters_apply_from_the_next_frame_on(ros_domain: int) -> None:
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        for i in range(2):
            rig.pose_of(corner_frame(START_NS + i * PERIOD_NS))
        # nothing is believed any more, and then everything again
        assert not set_parameter(rig, "odometry.min_planes", 10**6)
        assert not set_parameter(rig, "odometry.min_pixels", 10**6)
        node.wait_for_line("Changed: odometry.min_pixels: 1000000", 1.0)
        rig.publish(corner_frame(START_NS + 2 * PERIOD_NS))
        node.wait_for_line("Lost at 1.067", PATIENCE_S)
        assert not set_parameter(rig, "odometry.min_planes", 200)
        rig.pose_of(corner_frame(START_NS + 3 * PERIOD_NS))
        # the new start is for the next reset, so that odom does not jump
        assert not set_parameter(rig, "initial_pose", "5 0 0 0 0 0")
        x = rig.pose_of(corner_frame(START_NS + 4 * PERIOD_NS)).pose.position.x
        assert abs(x) < 0.01
        call(rig, "reset_odom")
        assert rig.pose_of(corner_frame(START_NS + 5 * PERIOD_NS)).pose.position.x == 5


@pytest.mark.slow
def test_a_missing_pose_is_explained_with_the_current_limits(ros_domain: int) -> None:
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        rig.pose_of(corner_frame(START_NS))
        assert not set_parameter(rig, "camera.depth_max", 0.5)
        beyond = corner_frame(START_NS + PERIOD_NS)
        # in the dark, lest colour alone give a pose
        rig.publish(replace(beyond, color=np.zeros_like(beyond.color)))
        why = "100% of the pixels have a depth, but 0% one from 0.1 to 0.5 m (camera.depth_min"
        node.wait_for_line(f"Lost at 1.033 ({why}", PATIENCE_S)

        def explained() -> bool:
            return any(why in message.status[0].message for message in rig.diagnostics)

        rig.wait(explained, "the reason on diagnostics")


@pytest.mark.slow
def test_given_values_override_the_preset_and_an_int_is_accepted_for_a_double(
    ros_domain: int,
) -> None:
    given = {"preset": "paper", "glue.k": 3, "odom_frame_id": "map"}
    with running_node(ros_domain, **given), Rig(ros_domain) as rig:
        client = AsyncParameterClient(rig.node, "rgbd_odometry")
        rig.wait(client.services_are_ready, "the parameter services")
        answer = client.get_parameters(["glue.k", "odom_frame_id", "features.geometric"])
        rig.wait(answer.done, "the values")
        values = [parameter_value_to_python(value) for value in answer.result().values]
        assert values == [3.0, "map", "fpfh"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"glue.k": 0.1}, "glue.k: 0.1 is out of range; give a number from 1 to 100, or 0"),
        ({"features.visual": "surf"}, "features.visual: 'surf' is not known; give one of none,"),
        ({"glue.k": "many"}, "glue.k: 'many' is not of type float"),
        ({"glue.kk": 7}, "glue.kk: no such parameter; did you mean glue.k?"),
        ({"guess_frame_id": "wheels"}, "guess_frame_id: needs frame_id and TF"),
    ],
)
def test_a_bad_parameter_is_refused_with_exit_code_2_and_a_line_that_says_why(
    ros_domain: int, given: dict[str, object], said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert said in refusal(node_module.main, ros_domain, capfd, given)


@pytest.mark.slow
@pytest.mark.every_python
def test_a_bad_parameter_ends_the_process_with_that_code_and_that_line(ros_domain: int) -> None:
    with running_node(ros_domain, **{"glue.k": 0.1}) as node:
        said = "glue.k: 0.1 is out of range; give a number from 1 to 100, or 0"
        node.wait_for_line(said, PATIENCE_S)
        assert node.wait_for_end(PATIENCE_S) == 2
        assert not [line for line in node.lines if "Traceback" in line]


@pytest.mark.slow
def test_invalid_ros_arguments_end_the_node_with_exit_code_2_and_one_line(
    ros_domain: int,
) -> None:
    with running_node(ros_domain, "--params-file", "/nowhere.yaml") as node:
        node.wait_for_line("Couldn't parse params file: '--params-file /nowhere.yaml'", PATIENCE_S)
        assert node.wait_for_end(PATIENCE_S) == 2
        assert not [line for line in node.lines if "Traceback" in line]
        assert node.lines[-1].endswith("Error opening YAML file; check the path")
    with running_node(ros_domain, "-r", "__node:=bad name") as node:
        node.wait_for_line("Couldn't parse remap rule", PATIENCE_S)
        assert node.wait_for_end(PATIENCE_S) == 2
        assert "; give -r FROM:=TO, with names of letters, digits, _ and /" in node.lines[-1]


@pytest.mark.slow
@pytest.mark.every_python
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_a_frame_is_processed_ends_the_node_with_exit_code_0(
    ros_domain: int, how: signal.Signals
) -> None:
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        rig.pose_of(corner_frame(START_NS, 640, 480))
        for i in range(1, 5):  # of which one is in work, and the last waits or is in work
            rig.publish(corner_frame(START_NS + i * PERIOD_NS, 640, 480))
        assert node.stop(how) == 0
        assert not [line for line in node.lines if "Traceback" in line]
        assert "frames" in node.lines[-1]  # the summary


@pytest.mark.slow
def test_a_robot_starts_at_the_origin_of_odom_wherever_its_camera_is(ros_domain: int) -> None:
    given = {"frame_id": "base_link", "camera_pose": "'0.2 0 0.5 0 0.3 0'"}
    with running_node(ros_domain, **given), Rig(ros_domain) as rig:
        rig.wait_until_matched()
        for i in range(2):
            pose = rig.pose_of(corner_frame(START_NS + i * PERIOD_NS))
        np.testing.assert_allclose(pose_from_message(pose, "pose"), np.eye(4), atol=2e-3)
        rig.wait(lambda: rig.odoms, "the odometry message")
        assert rig.odoms[0].child_frame_id == "base_link"


@pytest.mark.slow
def test_compressed_topics_follow_the_remapped_base_topics(ros_domain: int) -> None:
    given = {"image_transport": "compressed", "depth_transport": "compressedDepth"}
    remapped = {**SUBSCRIBED, Channel.COLOR: "/camera/color", Channel.DEPTH: "/camera/depth"}
    arguments = [
        word for c, name in remapped.items() for word in ("-r", f"{SUBSCRIBED[c]}:={name}")
    ]
    with (
        running_node(ros_domain, *arguments, **given),
        Rig(ros_domain, compressed=True, remapped=remapped) as rig,
    ):
        rig.wait_until_matched()
        rig.pose_of(corner_frame(START_NS))


@pytest.mark.slow
def test_depth_may_be_a_png_of_16_bits_on_a_compressed_topic(ros_domain: int) -> None:
    with running_node(ros_domain, depth_transport="compressed"), Rig(ros_domain) as rig:
        rig.depth = rig.publisher(CompressedImage, f"{SUBSCRIBED[Channel.DEPTH]}/compressed")
        rig.wait_until_matched()
        frame = corner_frame(START_NS)
        messages = frame_messages(frame, is_compressed=False)
        head = header(frame.stamp_ns, frame.frame_id)
        millimetres = quantised(frame.depth, DEPTH_UNITS_PER_METRE)
        png = np.frombuffer(encode_png(millimetres), np.uint8)
        image = CompressedImageFields(head, "16UC1; png compressed ", png)
        messages.depth = copy_fields(image, CompressedImage())
        rig.send(messages)
        rig.pose_at(START_NS)


@pytest.mark.slow
def test_a_publisher_that_restarts_with_another_reliability_is_received_again(
    ros_domain: int,
) -> None:
    stamps = itertools.count(START_NS, PERIOD_NS)
    with running_node(ros_domain):
        for reliability in (
            ReliabilityPolicy.BEST_EFFORT,
            ReliabilityPolicy.RELIABLE,
            ReliabilityPolicy.BEST_EFFORT,
        ):
            with Rig(ros_domain, reliability=reliability) as rig:
                rig.wait_until_matched()
                rig.publish_until_posed(map(corner_frame, stamps))


@pytest.mark.slow
def test_a_reliable_subscription_explains_why_it_gets_nothing_from_a_best_effort_publisher(
    ros_domain: int,
) -> None:
    with (
        running_node(ros_domain, qos=1) as node,
        Rig(ros_domain, reliability=ReliabilityPolicy.BEST_EFFORT),
    ):
        line = node.wait_for_line("/rgb/image is published by /rig", PATIENCE_S)
        assert "(sensor_msgs/msg/Image, best effort)" in line
        assert "/rgbd_odometry subscribes as reliable (qos:=1)" in line


@pytest.mark.slow
def test_a_subscription_that_asks_for_more_than_is_published_is_named(ros_domain: int) -> None:
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        rig.node.create_subscription(PoseStamped, POSE, print, latched)
        line = node.wait_for_line("/pose is published as reliable, volatile", PATIENCE_S)
        assert "/rig (reliable, transient local)" in line


@pytest.mark.slow
def test_a_camera_that_sees_nothing_is_lost_and_no_pose_is_invented(ros_domain: int) -> None:
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        rig.pose_of(corner_frame(START_NS))
        for i in (1, 2):
            rig.publish(covered(corner_frame(START_NS + i * PERIOD_NS)))
            node.wait_for_line("Lost at 1.033", PATIENCE_S)
        pose = rig.pose_of(corner_frame(START_NS + 3 * PERIOD_NS))
        node.wait_for_line("Tracking again", PATIENCE_S)
        np.testing.assert_allclose(pose_from_message(pose, "pose")[:3, 3], 0, atol=1e-2)
        assert len(rig.poses) == 2
        assert len([line for line in node.lines if "Lost at" in line]) == 1


@pytest.mark.slow
def test_silence_is_explained_by_the_missing_topic(ros_domain: int) -> None:
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        rig.node.destroy_publisher(rig.depth)
        line = node.wait_for_line("No frame for 5 s", PATIENCE_S)
        assert "/depth/image (depth) has no publisher" in line
        assert "/rgb/image (color) from /rig (sensor_msgs/msg/Image, reliable): 0 messages" in line


def test_a_misspelt_remapping_is_in_the_log(ros_domain: int) -> None:
    with running_node(ros_domain, "-r", "rgb/imge:=/foo") as node:
        line = node.wait_for_line("rgb/imge:=/foo", PATIENCE_S)
        assert "[WARN]" in line
        assert "did you mean rgb/image?" in line


@pytest.mark.slow
@pytest.mark.parametrize("is_compressed", [True, False])
def test_images_in_another_transport_are_named_with_the_parameters_to_set(
    is_compressed: bool, ros_domain: int
) -> None:
    given = {"image_transport": "compressed", "depth_transport": "compressedDepth"}
    with (
        running_node(ros_domain, **({} if is_compressed else given)) as node,
        Rig(ros_domain, compressed=is_compressed) as rig,
    ):
        rig.wait(rig.info.get_subscription_count, "the node", START_S)
        line = node.wait_for_line("No frame for 5 s", PATIENCE_S)
        assert "/rgb/image/compressed" in line
        assert line.endswith(
            "; /rgb/image/compressed and /depth/image/compressedDepth are published: start the "
            "node with --ros-args -p image_transport:=compressed "
            "-p depth_transport:=compressedDepth"
            if is_compressed
            else "; /rgb/image and /depth/image are published: start the node with --ros-args "
            "-p image_transport:=raw -p depth_transport:=raw"
        )


def call(rig: Rig, service: str) -> None:
    client = rig.node.create_client(Empty, f"/rgbd_odometry/{service}")
    rig.wait(client.service_is_ready, service)
    answer = client.call_async(Empty.Request())
    rig.wait(answer.done, f"the answer of {service}")
    rig.node.destroy_client(client)


@pytest.mark.slow
@pytest.mark.every_python
def test_reset_restarts_at_the_initial_pose_whatever_the_time(ros_domain: int) -> None:
    with running_node(ros_domain, initial_pose="'1 2 3 0 0 0.5'") as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        first = rig.pose_of(corner_frame(START_NS + PERIOD_NS))
        call(rig, "reset_odom")
        node.wait_for_line("Reset requested", PATIENCE_S)
        again = rig.pose_of(corner_frame(START_NS + 2 * PERIOD_NS))
        assert again.pose == first.pose
        expected = parse_pose("", "1 2 3 0 0 0.5") @ T_BODY_OPTICAL
        np.testing.assert_allclose(pose_from_message(again, "pose"), expected, atol=1e-12)
        rig.wait(lambda: len(rig.keyframes) == 2, "a keyframe after the reset")


@pytest.mark.parametrize("file", ["", "/", "~nobodyhere/graph.g2o", "/dev/null/graph.g2o"])
def test_a_graph_that_cannot_be_saved_is_reported_in_one_line(running: Running, file: str) -> None:
    assert not set_parameter(running.rig, "graph_file", file)
    answer = running.rig.trigger("/rgbd_odometry/save_graph")
    assert not answer.success
    assert answer.message.startswith("graph_file: ")
    running.node.wait_for_line(f"Saving the graph: {answer.message}", PATIENCE_S)
    assert not [line for line in running.node.lines if "Traceback" in line]


def test_no_frame_is_processed_while_paused_and_the_pose_continues_after_resume(
    running: Running,
) -> None:
    running.rig.pose_of(running.frame())
    call(running.rig, "pause_odom")
    poses = len(running.rig.poses)
    running.rig.publish(running.frame())
    running.rig.diagnostics.clear()

    def dropped() -> bool:
        return any(
            status.message == "paused"
            and KeyValue(key="dropped_paused", value="1") in status.values
            for message in running.rig.diagnostics
            for status in message.status
        )

    running.rig.wait(dropped, "the frame that was left out")
    assert len(running.rig.poses) == poses
    call(running.rig, "resume_odom")
    T = pose_from_message(running.rig.pose_of(running.frame()), "pose")
    np.testing.assert_allclose(T[:3, 3], 0, atol=2e-3)


@pytest.mark.slow
def test_frames_faster_than_the_update_rate_are_skipped_and_counted(ros_domain: int) -> None:
    with running_node(ros_domain, max_update_rate=10) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        for i in range(7):
            rig.publish(corner_frame(START_NS + i * PERIOD_NS))
            if i % 3 == 0:
                rig.pose_at(START_NS + i * PERIOD_NS)
        node.stop()
        assert "4 because it came sooner" in node.lines[-1]


@pytest.mark.slow
def test_with_exact_synchronisation_only_equal_stamps_pair(ros_domain: int) -> None:
    with running_node(ros_domain, approx_sync=False), Rig(ros_domain) as rig:
        rig.wait_until_matched()
        rig.publish(replace(corner_frame(START_NS), depth_delay_ns=1_000_000))
        rig.pose_of(corner_frame(START_NS + PERIOD_NS))
        assert len(rig.poses) == 1


@pytest.mark.slow
def test_without_always_process_most_recent_frame_every_frame_of_a_burst_gets_a_pose(
    ros_domain: int,
) -> None:
    given = {"always_process_most_recent_frame": False}
    with running_node(ros_domain, **given), Rig(ros_domain) as rig:
        rig.wait_until_matched()
        stamps = [START_NS + i * PERIOD_NS for i in range(8)]
        for stamp in stamps:
            rig.publish(corner_frame(stamp))
        for stamp in stamps:
            rig.pose_at(stamp)


@pytest.mark.slow
def test_a_lost_frame_gets_a_null_odometry_if_the_parameter_asks_for_it(ros_domain: int) -> None:
    with running_node(ros_domain, publish_null_when_lost=True) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        rig.pose_of(corner_frame(START_NS))
        rig.publish(covered(corner_frame(START_NS + PERIOD_NS)))
        node.wait_for_line("Lost at 1.033", PATIENCE_S)
        rig.wait(lambda: rig.odoms, "the odometry of the lost frame")
        odom = rig.odoms[-1]
        q = odom.pose.pose.orientation
        assert (q.x, q.y, q.z, q.w) == (0, 0, 0, 0)
        assert (odom.header.stamp.nanosec, odom.child_frame_id) == (PERIOD_NS, OPTICAL_FRAME)
        for covariance in (odom.pose.covariance, odom.twist.covariance):
            np.testing.assert_array_equal(covariance.reshape(6, 6), np.eye(6) * 9999)
        assert len(rig.poses) == 1


@pytest.mark.slow
def test_frames_that_were_never_sent_and_stamps_too_far_apart_are_reported(ros_domain: int) -> None:
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        stamps = [START_NS + i * PERIOD_NS for i in range(20) if i not in {12, 15}]
        # so far apart, the first pairs when the second shows to be no nearer
        rig.publish(replace(corner_frame(stamps[0]), depth_delay_ns=18_000_000))
        for stamp in stamps[1:]:
            rig.pose_of(replace(corner_frame(stamp), depth_delay_ns=18_000_000))
        line = node.wait_for_line("never sent", PATIENCE_S)
        assert "2 of 20 frames" in line
        line = node.wait_for_line("ms apart", PATIENCE_S)
        assert "18.0 ms apart, more than half of the 33.3 ms" in line


@pytest.mark.slow
@pytest.mark.every_python
def test_the_path_is_bounded_and_the_match_image_has_the_frames_stamp(
    ros_domain: int,
) -> None:
    given = {"path_poses": 3, "path_period": 0.05}
    with running_node(ros_domain, **given), Rig(ros_domain) as rig:
        paths: list[Path] = []
        pictures: list[Image] = []
        rig.node.create_subscription(Path, PATH, paths.append, 10)
        rig.node.create_subscription(Image, MATCHES, pictures.append, 10)
        rig.wait_until_matched()
        both = (PATH, MATCHES)
        rig.wait(lambda: all(map(rig.node.count_publishers, both)), "the publishers")
        stamps = [START_NS + i * PERIOD_NS for i in range(10)]
        for stamp in stamps:
            rig.pose_of(corner_frame(stamp))
        rig.wait(lambda: len(paths) == 5 and len(pictures) == 10, "path and pictures")
        # every second frame is 0.067 s after the one before
        kept = [stamp_ns(p.header.stamp) for p in paths[-1].poses]
        assert kept == stamps[4::2]
        assert [stamp_ns(p.header.stamp) for p in pictures] == stamps
        color = color_from_message(pictures[-1], MATCHES)
        assert (color == VISUAL).all(axis=2).sum() > 100


@pytest.mark.slow
def test_an_info_published_once_before_the_node_started_is_received(ros_domain: int) -> None:
    with Rig(ros_domain) as rig:
        rig.node.destroy_publisher(rig.info)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        rig.info = rig.node.create_publisher(CameraInfo, SUBSCRIBED[Channel.INFO], latched)
        frames = (corner_frame(START_NS + i * PERIOD_NS) for i in itertools.count(1))
        rig.info.publish(frame_messages(next(frames), is_compressed=False).info)
        with running_node(ros_domain) as node:
            node.wait_for_line("camera_info: subscribing as reliable, transient local", PATIENCE_S)
            for publisher in (rig.color, rig.depth):
                rig.wait(publisher.get_subscription_count, "the subscriptions to images")
            deadline = time.monotonic() + PATIENCE_S
            while not rig.poses and time.monotonic() < deadline:
                messages = frame_messages(next(frames), is_compressed=False)
                rig.color.publish(messages.color)
                rig.depth.publish(messages.depth)
                rig.spin_for(PERIOD_NS / NANOSECONDS)
            assert rig.poses
