"""``rgbd-glue demo``: a recording through the real node, over DDS."""

from __future__ import annotations

import argparse
from pathlib import Path

from rgbd_glue_ros.cli.arguments import add_output, positive_number


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Output and speed."""
    add_output(parser, Path("out/demo"))
    parser.add_argument(
        "--rate",
        type=positive_number,
        default=1.0,
        help="speed of the recording (default: %(default)s)",
    )


def run(args: argparse.Namespace) -> str:
    """Plays the bundled recording and returns its figures."""
    from rgbd_glue_ros.cli.progress import bar
    from rgbd_glue_ros.cli.replay import summary
    from rgbd_glue_ros.experiments.demo.demo import Progress, bundled_bag, demo
    from rgbd_glue_ros.experiments.replay.replay import REPORT

    with bar(" frames", desc="waiting for the node") as shown:

        def show(progress: Progress) -> None:
            shown.total = progress.frames
            shown.set_description("playing", refresh=False)
            shown.set_postfix_str(f"{progress.poses} poses", refresh=False)
            shown.update(progress.played - shown.n)

        result = demo(bundled_bag(), args.output, args.rate, show)
    said = f"node     {result.summary}\n" if result.summary else ""
    return f"{summary(result.figures)}{said}report   {args.output / REPORT}\n"
