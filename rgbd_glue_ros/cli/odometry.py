"""``rgbd-glue odometry``: the ROS node; it is also the executable ``odometry``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rgbd_glue_ros.cli.executable import run_executable

if TYPE_CHECKING:
    import argparse

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
    # late, since the executable catches signals first
    from rgbd_glue_ros.cli.node_command import add_node_arguments

    add_node_arguments(parser, _TOPICS, _PARAMETERS, _EXAMPLE)


def run(args: argparse.Namespace) -> str:
    """Runs the node until SIGINT, SIGTERM or SIGHUP."""
    from rgbd_glue_ros.cli.node_command import run_node

    return run_node(args, "rgbd_glue_ros.node.node")


def main() -> int:
    """The executable ``odometry``."""
    return run_executable("odometry")
