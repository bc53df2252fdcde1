"""A subscriber to the node's topics that says when it is matched, to be stopped.

Argument: ROS domain.
"""

from __future__ import annotations

import sys

import rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.event_handler import SubscriptionEventCallbacks

from rgbd_glue_ros.live.topics import ODOM, POSE


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main(domain: int) -> None:
    rclpy.init(domain_id=domain)
    node = rclpy.create_node("deaf")
    for kind, topic in ((PoseStamped, POSE), (Odometry, ODOM)):
        events = SubscriptionEventCallbacks(matched=lambda _, t=topic: say(t))
        node.create_subscription(kind, topic, lambda _: None, 10, event_callbacks=events)
    rclpy.spin(node)


if __name__ == "__main__":
    main(int(sys.argv[1]))
