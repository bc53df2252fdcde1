"""``rgbd-glue convert``: a recording in another format."""

from __future__ import annotations

import argparse

from rgbd_glue_ros.cli import arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """A recording and a new folder."""
    arguments.add_recording(parser)
    arguments.add_set(parser)
    parser.add_argument("target", metavar="DST", type=arguments.path, help="new folder to write to")
    parser.add_argument(
        "--compressed",
        action="store_true",
        help="write JPEG and compressedDepth to a bag in place of raw images, which lose nothing",
    )


def run(args: argparse.Namespace) -> str:
    """Converts and returns where the result is."""
    from rgbd_glue_ros.recordings.convert import convert

    with arguments.opener(args)(args.recording) as recording:
        convert(recording, args.target, args.compressed)
    return f"written: {args.target}\n"
