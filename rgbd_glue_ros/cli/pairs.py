"""``rgbd-glue pairs``: the experiments of the paper."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rgbd_glue_ros.cli import arguments, given_parameters
from rgbd_glue_ros.errors import InputError

if TYPE_CHECKING:
    from rgbd_glue_ros.experiments.pairs.experiment import Experiment
    from rgbd_glue_ros.experiments.pairs.methods import Estimator
    from rgbd_glue_ros.experiments.pairs.paper_tables import PaperTable

logger = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Recordings, parameters, output, pairs and methods."""
    arguments.add_recordings(parser, least="*")
    parser.add_argument(
        "--data",
        metavar="SRC",
        type=arguments.path,
        action="append",
        default=[],
        help="the same as SRC",
    )
    arguments.add_config(parser, preset="paper")
    parser.add_argument(
        "--gap",
        metavar="N",
        type=arguments.positive,
        action="append",
        help="frames between the two of a pair (default: 20); may be repeated",
    )
    parser.add_argument(
        "--every",
        metavar="N",
        type=arguments.positive,
        help="start a pair at every N-th frame (default: the gap)",
    )
    parser.add_argument(
        "--table",
        metavar="NUMBER",
        help="fill in a table of the paper, 1 to 6 or S1 to S3, at its gaps and with its methods",
    )
    parser.add_argument(
        "--peers",
        metavar="NAMES",
        default="",
        help="other methods to measure on the same pairs, separated by commas, or all",
    )
    arguments.add_output(parser, Path("out/pairs"))
    arguments.add_workers(parser)


def run(args: argparse.Namespace) -> str:
    """Registers the pairs and returns their figures."""
    from rgbd_glue_ros.experiments.pairs.paper_tables import write_table
    from rgbd_glue_ros.experiments.pairs.report import REPORT, TABLES

    table = _paper_table(args)
    experiment = _experiment(args, table)
    args.recordings += args.data
    if not args.recordings:
        raise InputError("pairs", "no recording is given", "name a data set or a bag")
    sources = arguments.sources(args)
    figures = _measured(args, sources, experiment)
    summary = _summary(figures)
    summary += f"tables   {args.output / TABLES}\nreport   {args.output / REPORT}\n"
    if table is None:
        return summary
    path = write_table(table, experiment.config, figures, args.output)
    return f"{summary}table    {path}\n\n{path.read_text(encoding='utf-8')}"


def _measured(
    args: argparse.Namespace, sources: list[Path], experiment: Experiment
) -> dict[str, Any]:
    """The figures of the experiment, with its progress shown."""
    from rgbd_glue_ros.cli.progress import bar, counted
    from rgbd_glue_ros.experiments.batch.workers import pool
    from rgbd_glue_ros.experiments.pairs.experiment import run_pairs

    with pool(args.workers, args.scheduler) as workers, bar(" pairs", 0) as progress:

        def expect(total: int, done: int) -> None:
            progress.total, progress.initial = total, done
            progress.update(done)
            if done:
                logger.warning("continuing after %s of an earlier run", counted(done, "pair"))

        def step(_: object) -> None:
            progress.update()

        try:
            return run_pairs(
                sources,
                arguments.opener(args),
                experiment,
                args.output,
                pool=workers,
                on_planned=expect,
                on_pair=step,
            )
        except KeyboardInterrupt:
            progress.close()
            if progress.n:
                logger.warning(
                    "interrupted; the results so far are in %s, and the same command continues",
                    args.output,
                )
            raise


def _experiment(args: argparse.Namespace, table: PaperTable | None) -> Experiment:
    from rgbd_glue_ros.experiments.pairs.experiment import Experiment

    config = given_parameters.config(args)
    others: dict[str, Estimator] = {peer: peer for peer in _peers(args.peers)}
    gaps = args.gap or [20]
    if table:
        others |= table.others(config)
        gaps = args.gap or table.gaps
    return Experiment(config, sorted({*gaps}), args.every, others)


def _paper_table(args: argparse.Namespace) -> PaperTable | None:
    from rgbd_glue_ros.experiments.pairs.paper_tables import paper_table

    return paper_table(args.table) if args.table else None


def _peers(text: str) -> list[str]:
    from rgbd_glue_ros.experiments.peers import PEERS

    names = list(PEERS) if text == "all" else [name for name in text.split(",") if name]
    for name in names:
        if name not in PEERS:
            raise InputError(
                f"--peers {name}", "no such peer", f"use all, or some of {', '.join(PEERS)}"
            )
    return names


def _summary(figures: dict[str, Any]) -> str:
    from rgbd_glue_ros.cli.progress import counted

    lines = []
    for gap, content in figures["gaps"].items():
        pairs = counted(content["pairs"], "pair")
        mean = "{rotation_deg[mean]:.2f} deg, {translation_cm[mean]:.2f} cm, {chamfer_mm[mean]:.2f}"
        lines.append(
            f"gap {gap:<4} {pairs}, {content['failed']} failed; mean error "
            f"{mean.format(**content)} mm chamfer; {content['seconds_per_pair']:.2f} s/pair\n"
        )
    return "".join(lines)
