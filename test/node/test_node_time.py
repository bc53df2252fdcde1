"""The node and time: simulated, standing still, told twice. Over real DDS."""

from __future__ import annotations

import pytest

from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.types import NANOSECONDS

pytest.importorskip("rclpy", reason="ROS is not installed")

from diagnostic_msgs.msg import KeyValue
from rigs.faults import node_in
from rigs.ros import START_NS, Rig, corner_frame
from rosgraph_msgs.msg import Clock

PERIOD_NS = NANOSECONDS // 30


@pytest.mark.slow
def test_with_simulated_time_poses_come_while_the_clock_stands_and_diagnostics_use_it(
    ros_domain: int,
) -> None:
    with node_in(ros_domain, use_sim_time=True), Rig(ros_domain) as rig:
        clock = rig.node.create_publisher(Clock, "/clock", 10)
        rig.wait_until_matched()
        rig.publish(corner_frame(0))
        rig.pose_of(corner_frame(PERIOD_NS))
        rig.pose_at(0)

        def stamps() -> set[int]:
            return {stamp_ns(message.header.stamp) for message in rig.diagnostics}

        rig.wait(lambda: 0 in stamps(), "diagnostics before the clock")
        rig.wait(clock.get_subscription_count, "the node's subscription to the clock")
        now = Clock()
        now.clock.sec = 1234
        clock.publish(now)
        rig.wait(lambda: 1234 * NANOSECONDS in stamps(), "diagnostics by the clock")
        rig.pose_of(corner_frame(2 * PERIOD_NS))
        assert [stamp_ns(pose.header.stamp) for pose in rig.poses] == [0, PERIOD_NS, 2 * PERIOD_NS]


@pytest.mark.slow
def test_a_frame_that_arrives_twice_or_late_is_counted_and_gets_no_second_pose(
    ros_domain: int,
) -> None:
    with node_in(ros_domain), Rig(ros_domain) as rig:
        rig.wait_until_matched()
        for i in (0, 1, 3):
            rig.pose_of(corner_frame(START_NS + i * PERIOD_NS))
        for i in (3, 2):  # again, and out of order
            rig.publish(corner_frame(START_NS + i * PERIOD_NS))
        rig.pose_of(corner_frame(START_NS + 4 * PERIOD_NS))

        def counted() -> bool:
            expected = [
                KeyValue(key=f"{channel}: {what}", value="1")
                for channel in ("color", "depth")
                for what in ("duplicates", "late")
            ]
            return any(
                all(item in status.values for item in expected)
                for message in rig.diagnostics
                for status in message.status
            )

        rig.wait(counted, "the counts of what came twice and late")
        stamps = [stamp_ns(pose.header.stamp) for pose in rig.poses]
        assert stamps == [START_NS + i * PERIOD_NS for i in (0, 1, 3, 4)]
