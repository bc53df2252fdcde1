"""A subscription follows its publishers, over real DDS."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="ROS is not installed")

from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rigs.ros import Rig
from sensor_msgs.msg import CameraInfo

from rgbd_glue_ros.node.following import FollowingSubscription, offered_durability

TOPIC = "/depth/camera_info"


def qos(publishers: list[TopicEndpointInfo]) -> QoSProfile:
    return QoSProfile(depth=1, durability=offered_durability(publishers))


@pytest.mark.slow
def test_an_info_is_received_whether_a_publisher_keeps_it_or_the_next_one_does_not(
    ros_domain: int,
) -> None:
    with Rig(ros_domain) as rig:
        received: list[CameraInfo] = []
        changes: list[DurabilityPolicy] = []
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        once = rig.node.create_publisher(CameraInfo, TOPIC, kept)
        once.publish(CameraInfo())
        FollowingSubscription(
            *(rig.node, CameraInfo, TOPIC, received.append, qos([]), qos),
            lambda new: changes.append(new.durability),
        )
        rig.wait(lambda: received, "the info that was sent before")
        rig.node.destroy_publisher(once)
        rig.spin_for(0.2)  # until the driver is started again
        again = rig.publisher(CameraInfo, TOPIC)
        rig.wait(again.get_subscription_count, "the subscription")
        again.publish(CameraInfo())
        rig.wait(lambda: len(received) == 2, "the info of the next publisher")
        assert changes == [DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE]
