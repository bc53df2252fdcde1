"""``rgbd-glue play``: any recording as the topics of a camera."""

from __future__ import annotations

import argparse
import os
from collections.abc import Collection

from rgbd_glue_ros.cli import arguments
from rgbd_glue_ros.errors import InputError, MissingExtraError

QOS = ("reliable", "best_effort")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """A recording, its part and speed, and how it is published."""
    arguments.add_recording(parser)
    arguments.add_set(parser)
    arguments.add_part(parser)
    parser.add_argument("--loop", action="store_true", help="begin again at its end")
    parser.add_argument("--qos", choices=QOS, default=QOS[0], help="(default: %(default)s)")


def run(args: argparse.Namespace) -> str:
    """Plays until the end, or until it is interrupted."""
    from rgbd_glue_ros.cli.progress import bar, counted
    from rgbd_glue_ros.experiments.demo.node_process import shared_environment
    from rgbd_glue_ros.messages.synchronizer import Channel

    os.environ.update(shared_environment())  # before ROS is loaded
    try:
        from rgbd_glue_ros.experiments.demo.player import Camera
    except ImportError as error:
        raise MissingExtraError("rclpy", "ros", "playing to topics") from error

    with arguments.opener(args)(args.recording) as recording:
        played = arguments.played(args, recording)
        with (
            Camera(played, reliable=args.qos == "reliable") as camera,
            bar(" frames", played.frame_count) as shown,
        ):
            shown.write(f"publishing {', '.join(camera.topics.values())}")
            shown.write(f"in another terminal: {arguments.node_command(args)}")
            while True:
                shown.reset()
                for message in camera.play(args.rate):
                    shown.update(message.channel is Channel.COLOR)
                if not args.loop:
                    break
                _require_loop(camera.frames_ns)
            count = counted(len(camera.frames_ns), "frame")
    return f"played {count} of {recording.name}\n"


def _require_loop(stamps_ns: Collection[int]) -> None:
    """Raises InputError where a node would take a second round for messages that come late."""
    from rgbd_glue_ros.messages.synchronizer import BACKWARD_JUMP_NS
    from rgbd_glue_ros.types import NANOSECONDS

    length_ns = max(stamps_ns) - min(stamps_ns)
    if length_ns <= BACKWARD_JUMP_NS:
        raise InputError(
            "--loop",
            f"{length_ns / NANOSECONDS:.2f} s are too short: stamps that go back by up to "
            f"{BACKWARD_JUMP_NS / NANOSECONDS:g} s are of late messages to a node",
            "play a longer part, or leave --loop out",
        )
