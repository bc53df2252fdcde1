"""``rgbd-glue play``: any recording on the topics of a camera."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

from rgbd_glue_ros.cli import arguments
from rgbd_glue_ros.cli.node_command import ros_arguments
from rgbd_glue_ros.errors import MissingExtraError

if TYPE_CHECKING:
    from rgbd_glue_ros.experiments.demo.player import Listeners

QOS = ("reliable", "best_effort")
_EPILOG = """\
ROS arguments, as for every node, follow --ros-args:
  -r __ns:=/robot                play into a namespace
  -r rgb/image:=/camera/color    publish on another topic

For example:
  rgbd-glue play recording/ --loop --ros-args -r __ns:=/robot
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """A recording, its part and speed, and how it is published; ROS arguments come elsewhere."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = _EPILOG
    arguments.add_recording(parser)
    arguments.add_set(parser)
    arguments.add_part(parser)
    arguments.add_camera(parser, "publish a camera's topics, for `odometry --camera`")
    parser.add_argument(
        "--loop", action="store_true", help="start over at its end, with increasing stamps"
    )
    parser.add_argument("--qos", choices=QOS, default=QOS[0], help="(default: %(default)s)")


def run(args: argparse.Namespace) -> str:
    """Plays until the end, or until it is interrupted."""
    from rgbd_glue_ros.cli.progress import bar, counted
    from rgbd_glue_ros.experiments.demo.node_process import shared_environment
    from rgbd_glue_ros.experiments.demo.played import begun
    from rgbd_glue_ros.live.camera_presets import load_camera
    from rgbd_glue_ros.messages.synchronizer import Channel

    ros = ros_arguments(args.ros, load_camera(args.camera)) if args.camera else args.ros
    os.environ.update(shared_environment())  # before ROS is loaded
    try:
        from rgbd_glue_ros.experiments.demo.player import Camera
    except ImportError as error:
        raise MissingExtraError("rclpy", "ros", "playing to topics") from error

    with arguments.opener(args)(args.recording) as recording:
        played = arguments.played(args, recording)
        # before the wait: to skip a long part takes a while, and there may be no frame after it
        messages = begun(played.messages)
        with (
            Camera(played, reliable=args.qos == "reliable", ros_arguments=ros) as camera,
            bar(" frames", played.frame_count) as shown,
        ):
            shown.write(f"publishing {', '.join(camera.topics.values())}")
            shown.write(f"in another terminal: {arguments.node_command(args)}")
            shown.write("waiting a few seconds for subscribers")
            shown.write(_said(camera.wait_for_listeners()))
            while True:
                shown.reset()
                stamps_ns = []
                for message in camera.play(args.rate, messages):
                    if message.channel is Channel.COLOR:
                        stamps_ns.append(message.stamp_ns)
                        shown.update()
                if not args.loop:
                    break
                played = played.next_round(stamps_ns)
                messages = iter(played.messages)
    return f"played {counted(len(stamps_ns), 'frame')} of {recording.name}\n"


def _said(listeners: Listeners) -> str:
    if not listeners.nodes:
        return "no subscriber; playing anyway"
    heard = f"received by {', '.join(listeners.nodes)}"
    unheard = f"; no subscriber of {', '.join(listeners.unheard)}" if listeners.unheard else ""
    return heard + unheard
