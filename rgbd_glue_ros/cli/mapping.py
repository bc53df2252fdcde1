"""``rgbd-glue mapping``: the node that closes loops; it is also the executable ``mapping``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rgbd_glue_ros.cli.executable import run_executable

if TYPE_CHECKING:
    import argparse

_TOPICS = "as of the odometry, and its pose, keyframe/pose, keyframe/edges"
_PARAMETERS = {
    "map_file": "map to start with, written by rgbd-glue map --save-map or ~/save_map",
    "localize_only": "look for the camera in that map, and do not change it",
    "save_map_file": "file that the service ~/save_map writes",
    "map_frame_id": "frame of the map, of which map_frame_id -> odom_frame_id is on TF",
    "max_width": "as of the odometry, like all parameters of images",
}
_EXAMPLE = "mapping --camera realsense_d400 --ros-args -p map_file:=room.rgbdmap -r __ns:=/robot"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of a node."""
    # late, since the executable catches signals first
    from rgbd_glue_ros.cli.node_command import add_node_arguments

    add_node_arguments(parser, _TOPICS, _PARAMETERS, _EXAMPLE)


def run(args: argparse.Namespace) -> str:
    """Runs the node until SIGINT, SIGTERM or SIGHUP."""
    from rgbd_glue_ros.cli.node_command import run_node

    return run_node(args, "rgbd_glue_ros.node.mapping")


def main() -> int:
    """The executable ``mapping``."""
    return run_executable("mapping")
