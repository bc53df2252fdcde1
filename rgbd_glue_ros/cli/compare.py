"""``rgbd-glue compare``: what differs between replays of a recording."""

from __future__ import annotations

import argparse

from rgbd_glue_ros.cli import arguments

_RUN = "output folder (-o) of rgbd-glue replay"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Two runs or more, and output."""
    parser.add_argument("first", metavar="RUN", type=arguments.path, help=f"{_RUN}, the reference")
    parser.add_argument(
        "others",
        metavar="RUN",
        type=arguments.path,
        nargs="+",
        help="the same of other runs of the recording: with other parameters, or by another "
        "version of this package",
    )
    arguments.add_output(parser, None, "none: the tables are only printed")


def run(args: argparse.Namespace) -> str:
    """Compares and returns the tables."""
    from rgbd_glue_ros.experiments.compare.comparison import (
        compare,
        figures_table,
        parameters_text,
    )
    from rgbd_glue_ros.experiments.compare.finished_run import read_runs
    from rgbd_glue_ros.experiments.compare.report import write_report

    comparison = compare(read_runs([args.first, *args.others]))
    text = f"{figures_table(comparison)}\n\n{parameters_text(comparison.runs)}\n"
    if args.output is None:
        return text
    report = write_report(comparison, args.output, arguments.command(args))
    return f"{text}\nreport   {report}\n"
