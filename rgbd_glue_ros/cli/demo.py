"""``rgbd-glue demo``: a recording through the real node, over DDS."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rgbd_glue_ros.cli import arguments, given_parameters

if TYPE_CHECKING:
    from rgbd_glue_ros.experiments.demo.played import Played
    from rgbd_glue_ros.parameters import InputConfig

logger = logging.getLogger(__name__)

# A node that keeps up processes at least this fraction of the frames.
_FEW = 0.9


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """A recording, its part and speed, and the output."""
    parser.add_argument(
        "recording",
        metavar="SRC",
        type=arguments.path,
        nargs="?",
        help=f"{arguments.RECORDING} (default: the bundled bag)",
    )
    arguments.add_topics(parser)
    arguments.add_output(parser, Path("out/demo"))
    arguments.add_part(parser)
    # unlike in other commands, also of the node alone
    parser.add_argument(
        "--set",
        dest="parameters",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="set a parameter of the node, as in --set max_width=640; may be repeated",
    ).completer = arguments.assignments  # type: ignore[attr-defined]


def run(args: argparse.Namespace) -> str:
    """Plays a recording to the node and returns the figures of its output."""
    from rgbd_glue_ros.experiments.demo.demo import bundled_bag
    from rgbd_glue_ros.experiments.demo.played import PlayedBag
    from rgbd_glue_ros.parameters import (
        InputConfig,
        by_current_names,
        parse_assignment,
        values,
        with_values,
    )

    given = by_current_names(dict(map(parse_assignment, args.parameters)))
    is_whole = not (args.start or args.duration or args.compressed or args.depth_scale)
    if args.recording is None and is_whole:
        return _play(args, PlayedBag.load(bundled_bag()), given, InputConfig())  # byte for byte
    # Reading pairs the images and completes them: the node gets equal stamps, and depth in metres
    of_reading = values(InputConfig()).keys() - {"max_width"}
    read = {name: given.pop(name) for name in of_reading if name in given}
    inputs = with_values(given_parameters.inputs_of(args), read)
    with arguments.opener(args, inputs)(args.recording or bundled_bag()) as recording:
        return _play(args, arguments.played(args, recording), given, inputs)


def _play(
    args: argparse.Namespace,
    recording: Played,
    parameters: Mapping[str, object],
    inputs: InputConfig,
) -> str:
    from rgbd_glue_ros.cli.progress import bar
    from rgbd_glue_ros.cli.replay import interrupted, summary
    from rgbd_glue_ros.experiments.demo.demo import Progress, demo
    from rgbd_glue_ros.experiments.replay.result_names import REPORT

    waiting = "waiting for the node (compiling once)"
    with bar(" frames", desc=waiting) as shown:

        def show(progress: Progress) -> None:
            if progress.played == 0:
                shown.refresh()  # the time goes on
                return
            shown.total = progress.frames
            shown.set_description("playing", refresh=False)
            shown.set_postfix_str(f"{progress.poses} poses", refresh=False)
            shown.update(progress.played - shown.n)

        command = arguments.command(args)
        try:
            result = demo(recording, args.output, args.rate, show, command, parameters, inputs)
        except KeyboardInterrupt:
            shown.close()
            logger.warning("%s", interrupted(args.output))
            raise
    said = ""
    if result.summary:
        said = f"node     {result.summary}; its latency: from receiving images to their pose\n"
    played = result.figures["played"]
    if result.figures["frames"] < _FEW * played:
        said += (
            "note     frames were dropped: this machine was busy with other work, or its images "
            "are large (max_width; docs/node.md)\n"
        )
    return f"{summary(result.figures)}{said}report   {args.output / REPORT}\n"
