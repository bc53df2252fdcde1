"""``rgbd-glue convert``: a recording in another format."""

from __future__ import annotations

import argparse
import shlex
from typing import TYPE_CHECKING

from rgbd_glue_ros.cli import arguments
from rgbd_glue_ros.cli.parser import PROGRAM
from rgbd_glue_ros.errors import InputError

if TYPE_CHECKING:
    from rgbd_glue_ros.recordings.bag.writer import WrittenTopics

TOPICS_LIKE = "realsense_d400"
_FILES = (".mcap", ".db3", ".bag")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """A recording and a new folder."""
    arguments.add_recording(parser)
    arguments.add_set(parser)
    parser.add_argument("target", metavar="DST", type=arguments.path, help="new folder to write to")
    parser.add_argument(
        "--compressed",
        action="store_true",
        help="write JPEG and compressedDepth to a bag instead of lossless raw images",
    )
    parser.add_argument(
        "--topics-like",
        metavar="PRESET",
        help="name a bag's topics as a camera's driver does: a name in config/cameras, such as "
        f"oak_d (default: {TOPICS_LIKE})",
    ).completer = arguments.camera_presets  # type: ignore[attr-defined]


def run(args: argparse.Namespace) -> str:
    """Converts and returns where the result is, its content and how to use it."""
    from rgbd_glue_ros.recordings.convert import convert, is_bag

    topics = _topics(args)
    if args.target.suffix in _FILES:
        raise InputError(
            args.target,
            "is the name of a file, but what is written is a folder, as every rosbag2 is",
            f"give it a name without {args.target.suffix}",
        )
    with arguments.opener(args)(args.recording) as recording:
        is_from_bag = is_bag(recording)
        if is_from_bag and args.topics_like:
            raise InputError(
                "--topics-like",
                f"{args.recording} is a bag, which becomes a folder of images",
                "leave it out",
            )
        convert(recording, args.target, args.compressed, topics)
    size_mb = sum(p.stat().st_size for p in args.target.rglob("*") if p.is_file()) / 1e6
    text = f"written  {args.target}, {size_mb:.1f} MB\n"
    if not is_from_bag:
        suffixes = ("/compressed", "/compressedDepth") if args.compressed else ("", "")
        named = (topics.color + suffixes[0], topics.depth + suffixes[1], topics.info)
        text += f"topics   {', '.join(named)}\n"
    play = [PROGRAM, "play", str(args.target)]
    if args.topics_like:
        play += ["--camera", args.topics_like]
    return f"{text}play it  {shlex.join(play)}\n"


def _topics(args: argparse.Namespace) -> WrittenTopics:
    """The names for the topics of a bag."""
    from rgbd_glue_ros.live.camera_presets import load_camera
    from rgbd_glue_ros.recordings.bag.writer import AS_REALSENSE, WrittenTopics

    named = load_camera(args.topics_like or TOPICS_LIKE).topics
    imu = named.get("imu", AS_REALSENSE.imu)
    return WrittenTopics(named["color"], named["depth"], named["camera_info"], imu)
