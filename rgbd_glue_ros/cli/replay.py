"""``rgbd-glue replay``: the odometry over one recording or many."""

from __future__ import annotations

import argparse
import json
import logging
from pathlib import Path
from typing import Any

from rgbd_glue_ros.cli import arguments, exports, given_parameters
from rgbd_glue_ros.errors import IncompleteError, InputError

logger = logging.getLogger(__name__)

OUTPUT = Path("out/replay")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Recordings, parameters, output, truth and workers."""
    arguments.add_recordings(parser)
    arguments.add_config(parser)
    arguments.add_output(parser, None, f"{OUTPUT}/NAME of one SRC, {OUTPUT} of many")
    arguments.add_ground_truth(parser)
    arguments.add_limit(parser)
    exports.add_exports(parser)
    arguments.add_workers(parser)


def run(args: argparse.Namespace) -> str:
    """Replays and returns the figures, or the table of many."""
    sources = arguments.sources(args)
    if len(sources) > 1:
        return _replay_many(args, sources, args.output or OUTPUT)
    (source,) = sources
    return _replay_one(args, source, args.output or OUTPUT / source.resolve().stem)


def _replay_many(args: argparse.Namespace, sources: list[Path], folder: Path) -> str:
    from rgbd_glue_ros.cli.progress import bar, counted
    from rgbd_glue_ros.experiments.batch.workers import pool
    from rgbd_glue_ros.experiments.replay.batch import TABLE, run_replays

    if args.ground_truth:
        raise InputError("--ground-truth", "is of one recording", "give one SRC")
    if args.mcap or args.cloud or args.rerun:
        raise InputError("--mcap, --cloud, --rerun", "are of one recording", "give one SRC")
    config = given_parameters.config(args)
    with (
        pool(args.workers, args.scheduler) as workers,
        bar(" recordings", len(sources)) as shown,
    ):

        def expect(_: int, done: int) -> None:
            shown.update(done)
            if done:
                said = counted(done, "recording")
                logger.warning("continuing after %s of an earlier run", said)

        def step(name: str) -> None:
            shown.set_postfix_str(name, refresh=False)
            shown.update()

        figures = run_replays(
            sources,
            arguments.opener(args),
            config,
            folder,
            pool=workers,
            limit=args.limit,
            on_planned=expect,
            on_replayed=step,
        )
    table = folder / TABLE
    text = f"{table.read_text(encoding='utf-8')}table    {table}\n"
    failed = len(figures["problems"])
    if failed:
        error = IncompleteError(
            f"{failed} of {counted(len(sources), 'recording')}",
            "could not be replayed",
            "why is said above",
        )
        error.output = text
        raise error
    return text


def _replay_one(args: argparse.Namespace, source: Path, folder: Path) -> str:
    from rgbd_glue_ros.cli.progress import tracking_bar
    from rgbd_glue_ros.experiments.replay.replay import replay
    from rgbd_glue_ros.experiments.replay.result_names import METRICS, REPORT, RESULTS, TRAJECTORY
    from rgbd_glue_ros.experiments.replay.run_warnings import heard_warnings

    config = given_parameters.config(args)
    with heard_warnings() as heard, arguments.opened(args, source) as recording:
        exports.check(args, folder, RESULTS)
        try:
            with tracking_bar(recording.frame_count) as show:
                replay(
                    recording,
                    config,
                    folder,
                    on_frame=show,
                    outputs=exports.further_outputs(args, recording),
                    provenance=arguments.provenance(args, heard),
                )
        except KeyboardInterrupt:
            logger.warning("%s", interrupted(folder))
            raise
    figures = json.loads((folder / METRICS).read_text(encoding="utf-8"))
    asked = {"bag": args.mcap, "cloud": args.cloud, "rerun": args.rerun}
    lines = [f"{name:<8} {place}\n" for name, place in asked.items() if place]
    text = f"{summary(figures)}poses    {folder / TRAJECTORY}\n{''.join(lines)}"
    return f"{text}report   {folder / REPORT}\n"


def interrupted(folder: Path) -> str:
    """What an interrupted run has left in its folder."""
    from rgbd_glue_ros.experiments.replay.result_names import METRICS

    if not (folder / METRICS).is_file():
        return "interrupted before the first frame was done; there are no results"
    return f"interrupted; the results so far are in {folder}"


def _input(figures: dict[str, Any]) -> str:
    """A line about what was wrong with the frames, if anything was."""
    from rgbd_glue_ros.cli.progress import counted

    restarts, duplicates = figures["restarts"], figures["duplicates"]
    said = [
        f"{counted(restarts, 'restart')} as time went back" if restarts else "",
        f"{counted(duplicates, 'duplicate')} left out" if duplicates else "",
        *(
            f"{counted(count, f'{kind} image')} unpaired"
            for kind, count in (figures["unpaired"] or {}).items()
            if count
        ),
    ]
    text = ", ".join(filter(None, said))
    if not text:
        return ""
    return f"input    {text}; longest gap {figures['longest_gap_s']:.2f} s\n"


def summary(figures: dict[str, Any]) -> str:
    """The figures of ``metrics.json`` in a few lines."""
    from rgbd_glue_ros.cli.progress import counted
    from rgbd_glue_ros.evaluation.trajectory_errors import NO_RPE

    is_whole = figures["frames"] == figures["played"]
    frames = "{frames}" if is_whole else "{frames} of {played} processed"
    frames += ", of which {tracked} tracked and {lost} lost; "
    speed = "{fps:.1f} frames/s; latency {p50:.1f} ms, p95 {p95:.1f} ms"
    if "node_latency_ms" in figures:
        speed += ", from publishing images until their pose is back"
    keyframes = counted(figures["keyframes"], "keyframe")
    text = f"frames   {frames.format(**figures)}{keyframes}\n{_input(figures)}"
    text += f"path     {figures['path_m']:.2f} m\n"
    text += f"speed    {speed.format(fps=figures['fps'], **figures['latency_ms'])}\n"
    if "ape" not in figures:
        return f"{text}APE      none: {figures.get('no_ape', 'there is no ground truth')}\n"
    text += f"APE      {figures['ape']['rmse_m']:.4f} m rmse, SE(3) aligned\n"
    if not figures["rpe"]:
        text += f"RPE      none: {NO_RPE}\n"
    else:
        rpe = "{trans_rmse_m:.4f} m, {rot_rmse_deg:.3f} deg rmse over {delta_s:g} s"
        text += f"RPE      {rpe.format(**figures['rpe'])}\n"
    return text
