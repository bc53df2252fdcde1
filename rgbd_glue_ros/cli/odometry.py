"""``rgbd-glue odometry``: the ROS node; it is also the executable ``odometry``."""

from __future__ import annotations

import argparse
import sys

from rgbd_glue_ros.cli.node_command import add_node_arguments, run_node

_TOPICS = "rgb/image, depth/image, rgb/camera_info, imu"
_PARAMETERS = {
    "frame_id": "frame of the robot, whose pose is published, such as base_link",
    "max_width": "width that wider images are reduced to, pixels",
    "image_transport": "raw or compressed; depth_transport: raw or compressedDepth",
    "depth_scale": "metres per unit of depth, where that is not as REP-118 says",
    "publish_tf": "whether odom -> frame_id is on TF",
    "preset": "live or paper, from which all other parameters start",
}
_EXAMPLE = "odometry --camera realsense_d400 --ros-args -p frame_id:=base_link -r __ns:=/robot"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of a node."""
    add_node_arguments(parser, _TOPICS, _PARAMETERS, _EXAMPLE)


def run(args: argparse.Namespace) -> str:
    """Runs the node until SIGINT, SIGTERM or SIGHUP."""
    return run_node(args, "rgbd_glue_ros.node.node")


def main() -> int:
    """The executable ``odometry``."""
    from rgbd_glue_ros.cli.main import main as run_command

    return run_command(["odometry", *sys.argv[1:]])
