"""``rgbd-glue bench``: speed and error compared with others."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path
from typing import TYPE_CHECKING

from rgbd_glue_ros.cli import arguments, given_parameters

if TYPE_CHECKING:
    from rgbd_glue_ros.experiments.bench import Plan
    from rgbd_glue_ros.experiments.bench.part import Part
    from rgbd_glue_ros.recordings import Recording

logger = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Recordings, parameters, output, and what is measured."""
    parser.add_argument(
        "recordings",
        metavar="SRC",
        type=arguments.path,
        nargs="*",
        help=f"{arguments.RECORDING}; the bundled recording if none is given",
    )
    arguments.add_topics(parser)
    arguments.add_config(parser)
    arguments.add_output(parser, Path("out/bench"))
    arguments.add_limit(parser)
    parser.add_argument(
        "--peer",
        metavar="NAME",
        action="append",
        help="peer to compare with (default: those for odometry); may be repeated",
    )
    parser.add_argument(
        "--patience",
        metavar="S",
        type=arguments.positive_number,
        default=120.0,
        help="seconds for each peer and recording; only what it completes by then counts "
        "(default: %(default)g)",
    )
    parser.add_argument(
        "--robustness",
        action="store_true",
        help="also with frames missing, dark, blank or patchy, or with a passer-by",
    )
    parser.add_argument(
        "--live",
        action="store_true",
        help="also play to the node over DDS, at the recording's rate",
    )
    parser.add_argument(
        "--memory",
        metavar="N",
        type=arguments.positive,
        default=0,
        help="also measure memory over N frames of the first recording, repeated",
    )


def run(args: argparse.Namespace) -> str:
    """Measures and returns the tables."""
    from rgbd_glue_ros.experiments.bench import ODOMETRIES, REPORT, TABLES, Plan

    plan = Plan(
        given_parameters.config(args),
        args.peer or ODOMETRIES,
        args.limit,
        args.patience,
        args.robustness,
        args.live,
        args.memory,
        command=arguments.command(args),
    )
    _measure(args, plan)
    tables = args.output / TABLES
    text = tables.read_text(encoding="utf-8")
    return f"{text}\ntables   {tables}\nreport   {args.output / REPORT}\n"


def _measure(args: argparse.Namespace, plan: Plan) -> None:
    """Measures, with the progress shown."""
    from rgbd_glue_ros.cli.progress import bar
    from rgbd_glue_ros.experiments.bench import run_bench
    from rgbd_glue_ros.experiments.demo.demo import bundled_bag
    from rgbd_glue_ros.recordings import recordings

    with bar(" frames", 0) as shown:

        def begin(part: Part, recording: Recording) -> None:
            shown.reset(part.frame_count)
            shown.set_description(f"{recording.name}, {part.title}")

        def step() -> None:
            shown.update()

        try:
            run_bench(
                recordings(args.recordings or [bundled_bag()]),
                arguments.opener(args),
                plan,
                args.output,
                on_part=begin,
                on_frame=step,
            )
        except KeyboardInterrupt:
            shown.close()
            is_measured = args.output.is_dir() and any(args.output.iterdir())
            what = f"the results so far are in {args.output}" if is_measured else "nothing measured"
            logger.warning("interrupted; %s", what)
            raise
