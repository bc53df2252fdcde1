"""What cannot be tracked is told once and stays on /diagnostics, through the node over real DDS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rgbd_glue_ros.live.topics import MATCHES
from rgbd_glue_ros.messages.images import color_from_message
from rgbd_glue_ros.messages.making import color_image, copy_fields, depth_image, header
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.types import NANOSECONDS

pytest.importorskip("rclpy", reason="ROS is not installed")

from diagnostic_msgs.msg import DiagnosticStatus
from rigs.faults import healthy, node_in, rig_node
from rigs.ros import PATIENCE_S, Rig, corner_frame, frame_messages
from sensor_msgs.msg import Image

START_NS = 1_700_000_000 * NANOSECONDS
PERIOD_NS = NANOSECONDS // 30
# what depth is multiplied by, and what is told of it
USELESS = (
    (0.0, "0% of the pixels have a depth: check that the topic"),
    (1000.0, "so these are millimetres: set depth_scale to 0.001"),
    (10.0, "if the unit is another, set depth_scale"),
)


def told(rig: Rig) -> str:
    """The message of the node's last diagnostics."""
    return str(rig.diagnostics[-1].status[0].message) if rig.diagnostics else ""


@pytest.mark.slow
def test_unusable_depth_is_logged_once_for_each_cause_and_reported_in_diagnostics(
    ros_domain: int,
) -> None:
    with node_in(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        stamps = iter(range(START_NS, START_NS + 1000 * PERIOD_NS, PERIOD_NS))
        for factor, why in USELESS:

            def shows(why: str = why, factor: float = factor) -> bool:
                frame = corner_frame(next(stamps))
                rig.publish(replace(frame, depth=frame.depth * np.float32(factor)))
                rig.spin_for(0.1)
                return why in told(rig)

            rig.wait(shows, why)
            assert "No pose yet" in node.wait_for_line(why, PATIENCE_S)
        rig.pose_of(corner_frame(next(stamps)))
        for _, why in USELESS:
            said = [line for line in node.lines if "No pose yet" in line and why in line]
            assert len(said) == 1
        # of the unit, the first line stands for all
        assert len([line for line in node.lines if "the median depth is" in line]) == 1


@pytest.mark.slow
def test_images_without_a_stamp_use_the_time_of_receipt_which_is_logged_once(
    ros_domain: int,
) -> None:
    with node_in(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()

        def has_poses() -> bool:
            rig.publish(corner_frame(0))
            rig.spin_for(0.1)
            return len(rig.poses) > 2

        rig.wait(has_poses, "poses")
        assert min(stamp_ns(pose.header.stamp) for pose in rig.poses) > START_NS
        for topic in ("rgb/image", "depth/image", "rgb/camera_info"):
            lines = [line for line in node.lines if f"/{topic}: has no stamp" in line]
            assert len(lines) == 1


@pytest.mark.slow
def test_silence_is_logged_once_for_each_cause_however_much_arrives(ros_domain: int) -> None:
    """First images without depth, in numbers that differ, then depth without images."""
    with healthy(rig_node(ros_domain, "hasty_node")) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        frame = corner_frame(0)
        seen: set[str] = set()

        def publish(number: int, *, is_color: bool) -> None:
            head = header(START_NS + number * PERIOD_NS, frame.frame_id)
            image = color_image(frame.color, head) if is_color else depth_image(frame.depth, head)
            (rig.color if is_color else rig.depth).publish(copy_fields(image, Image()))

        numbers = iter(range(10**6))

        def is_seen(line: str, times: int, *, is_color: bool) -> bool:
            publish(next(numbers), is_color=is_color)
            rig.spin_for(0.05 * (1 + len(seen)))
            if line in told(rig):
                seen.add(told(rig))
            return len(seen) >= times

        missing = "; depth and camera_info are missing: "
        rig.wait(lambda: is_seen(missing, 2, is_color=True), "two looks at images")
        seen.clear()
        rig.wait(lambda: is_seen("; color stopped: ", 1, is_color=False), "a look at depth")
        seen.clear()
        rig.wait(lambda: is_seen("; depth stopped: ", 1, is_color=True), "a look at images")
        lines = [line for line in node.lines if "No frame for 1 s" in line]
        assert len({line.partition("No frame")[2] for line in lines}) == len(lines)
        for cause in (missing, "; color stopped: ", "; depth stopped: "):
            assert len([line for line in lines if cause in line]) == 1


@pytest.mark.slow
def test_what_arrives_after_a_look_counts_at_once_and_a_camera_that_stops_is_said_to(
    ros_domain: int,
) -> None:
    with node_in(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        rig.wait(lambda: "are missing: check whether the camera" in told(rig), "a look at nothing")
        for i in range(2):
            rig.pose_of(corner_frame(START_NS + i * PERIOD_NS))
        rig.diagnostics.clear()
        rig.wait(lambda: rig.diagnostics, "diagnostics")
        assert told(rig) == "tracking"
        rig.wait(lambda: told(rig).startswith("no frame for "), "the first seconds without a frame")
        assert rig.diagnostics[-1].status[0].level == DiagnosticStatus.STALE
        line = node.wait_for_line("color and depth and camera_info stopped: ", PATIENCE_S)
        assert "[WARN]" in line
        assert "No frame for 5 s: /rgb/image (color) from /rig " in line
        assert "the last of 2 messages came " in line
        assert "0 messages" not in line
        rig.wait(lambda: "stopped: the driver hangs" in told(rig), "the same on /diagnostics")


@pytest.mark.slow
def test_a_hiccup_is_not_the_reason_for_a_later_silence(ros_domain: int) -> None:
    with node_in(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        numbers = iter(range(10**6))
        # depth comes once, after so many colour images that the first of them are dropped
        frames = [corner_frame(START_NS + next(numbers) * PERIOD_NS) for _ in range(30)]
        messages = [frame_messages(frame, is_compressed=False) for frame in frames]
        for each in messages:
            rig.color.publish(each.color)
            rig.spin_for(0.01)
        for each in messages[:15]:
            rig.depth.publish(each.depth)
            rig.spin_for(0.01)

        def logs(why: str, depth_delay_ns: int = 0) -> bool:
            frame = corner_frame(START_NS + next(numbers) * PERIOD_NS)
            rig.publish(replace(frame, depth_delay_ns=depth_delay_ns))
            rig.spin_for(0.05)
            return any(why in line for line in node.lines)

        rig.wait(lambda: logs("set sync_queue_size:="), "what the hiccup needed")
        hour_ns = 3600 * NANOSECONDS
        rig.wait(lambda: logs("No frame for 5 s", hour_ns), "the silence")
        assert "they come from two clocks" in node.wait_for_line("No frame for 5 s", PATIENCE_S)


@pytest.mark.slow
def test_infrared_of_ten_bits_is_seen_with_its_texture(ros_domain: int) -> None:
    with node_in(ros_domain), Rig(ros_domain) as rig:
        pictures: list[Image] = []
        rig.node.create_subscription(Image, MATCHES, pictures.append, 10)
        rig.wait_until_matched()
        rig.wait(lambda: rig.node.count_publishers(MATCHES), "the publisher")
        frame = corner_frame(START_NS)
        messages = frame_messages(frame, is_compressed=False)
        counts = frame.color[..., 0].astype("<u2") * 4
        grey = color_image(frame.color[..., 0], header(START_NS, frame.frame_id))
        messages.color = copy_fields(grey, Image())
        messages.color.encoding, messages.color.step = "mono16", 2 * grey.step
        messages.color.data = counts.tobytes()
        rig.send(messages)
        rig.wait(lambda: pictures, "the picture of the frame")
        # below the lines of text; the picture is dimmed
        picture = color_from_message(pictures[0], MATCHES)[20:, :, 0]
        dimmed = picture.std() / frame.color[20:, :, 0].std()
        assert 0.4 < dimmed < 1


@pytest.mark.slow
def test_images_that_all_have_one_stamp_are_reported_with_the_parameter_to_set(
    ros_domain: int,
) -> None:
    with healthy(rig_node(ros_domain, "hasty_node")) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()

        def is_told() -> bool:
            rig.publish(corner_frame(START_NS))
            rig.spin_for(0.1)
            return "repeat one stamp" in told(rig)

        rig.wait(is_told, "the cause")
        line = node.wait_for_line("repeat one stamp", PATIENCE_S)
        assert "the messages of color and depth repeat one stamp" in line
        assert "-p stamps:=receipt" in line
