"""``rgbd-glue watch``: the odometry's pose and state, as they come."""

from __future__ import annotations

import argparse
import sys
from contextlib import nullcontext

from rgbd_glue_ros.cli import arguments
from rgbd_glue_ros.cli.node_command import run_module

_EPILOG = """\
It subscribes to odom and /diagnostics of the node, which may be started before or after it, and
shows state, poses per second, median latency from the image's stamp to the arrival of its pose,
position, length of the path and the turn since the first pose; where there is no pose, why.

ROS arguments, as for every node, follow --ros-args:
  -r __ns:=/robot           watch the node in a namespace
  -r odom:=/visual/odom     watch another topic
  -p use_sim_time:=true     take the latency by the clock of a simulation

For example:
  rgbd-glue watch -o trajectory.txt --ros-args -r __ns:=/robot
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The file that poses are recorded to; ROS arguments are handled elsewhere."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.usage = "%(prog)s [-h] [--debug] [-o FILE] [--ros-args ...]"
    parser.epilog = _EPILOG
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        type=arguments.path,
        help="record the poses to a new file, in TUM format",
    )


def run(args: argparse.Namespace) -> str:
    """Watches until SIGINT, SIGTERM or SIGHUP."""
    from rgbd_glue_ros.cli.status_line import StatusLine
    from rgbd_glue_ros.trajectories.recorder import PoseRecorder

    screen = StatusLine(sys.stdout)
    opened = nullcontext(None) if args.output is None else PoseRecorder(args.output)
    with opened as recorder:
        try:
            run_module("rgbd_glue_ros.node.watch", args.ros, screen=screen, recorder=recorder)
        except SystemExit:
            if screen.fault is not None:
                raise screen.fault from None
            raise
    return ""
