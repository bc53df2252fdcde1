"""Outputs of ``replay`` and ``map`` for other programs."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rgbd_glue_ros.cli import arguments
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.user_paths import expanded

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from rgbd_glue_ros.experiments.replay.outputs import FurtherOutputs
    from rgbd_glue_ros.experiments.replay.sinks import FrameSink
    from rgbd_glue_ros.recordings import Recording
    from rgbd_glue_ros.viz.rerun_recording import RerunRecording


def add_rerun(parser: argparse.ArgumentParser) -> None:
    """``--rerun``."""
    parser.add_argument(
        "--rerun",
        metavar="FILE.rrd",
        help="write images, scene, matches and plots for the Rerun viewer (extra viz), or show "
        "them in a running one: rerun+http://127.0.0.1:9876/proxy",
    )


def rerun_recording(args: argparse.Namespace, recording: Recording) -> RerunRecording | None:
    """The recording requested by ``--rerun``.

    Raises:
        InputError: it cannot be written.
        MissingExtraError: Rerun is not installed.
    """
    from rgbd_glue_ros.viz.rerun_recording import RerunRecording

    return RerunRecording(args.rerun, recording.ground_truth) if args.rerun else None


def add_exports(parser: argparse.ArgumentParser) -> None:
    """``--mcap``, ``--cloud`` and ``--rerun``."""
    parser.add_argument(
        "--mcap",
        metavar="DIR",
        type=arguments.path,
        help="write what the node would have published as a rosbag2 in MCAP (Foxglove, RViz)",
    )
    parser.add_argument(
        "--cloud",
        metavar="FILE.ply",
        type=arguments.path,
        help="write a coloured cloud of the keyframes along the trajectory; the report shows it",
    )
    add_rerun(parser)


def check(args: argparse.Namespace, folder: Path, results: Collection[str]) -> None:
    """Refuses places of the options that no result can have, before anything is opened.

    Args:
        args: as parsed.
        folder: where the results go.
        results: names of the files in it that the command writes.

    Raises:
        InputError: a place is taken, or cannot be written.
    """
    from rgbd_glue_ros.experiments.replay.places import check_places
    from rgbd_glue_ros.viz.rerun_recording import ADDRESS

    is_file = args.rerun and not args.rerun.startswith(ADDRESS)
    given = vars(args)
    check_places(
        folder,
        results,
        {"--cloud": given.get("cloud"), "--save-map": given.get("save_map")},
        {
            "--mcap": given.get("mcap"),
            "--rerun": expanded(args.rerun, "--rerun") if is_file else None,
        },
    )
    cloud = given.get("cloud")
    if cloud is not None and cloud.suffix.lower() not in ("", ".ply"):
        raise InputError(
            "--cloud",
            f"{cloud} is written as PLY, whatever its name",
            "give a name that ends in .ply",
        )


def further_outputs(args: argparse.Namespace, recording: Recording) -> FurtherOutputs:
    """The outputs requested by the arguments of ``add_exports``.

    Args:
        args: as parsed.
        recording: the replayed recording.

    Raises:
        InputError: it cannot be written.
        MissingExtraError: a library is not installed.
    """
    from rgbd_glue_ros.experiments.replay.bag_sink import BagSink
    from rgbd_glue_ros.experiments.replay.outputs import FurtherOutputs

    asked: list[FrameSink] = []
    if args.mcap:
        asked.append(BagSink(args.mcap))
    shown = rerun_recording(args, recording)
    if shown is not None:
        asked.append(shown)
    return FurtherOutputs(asked, args.cloud, files(args))


def files(args: argparse.Namespace) -> tuple[Path, ...]:
    """What is written from the first frame on: the bag, and the file for Rerun."""
    from rgbd_glue_ros.viz.rerun_recording import ADDRESS

    bag = vars(args).get("mcap")
    is_file = args.rerun and not args.rerun.startswith(ADDRESS)
    rerun = expanded(args.rerun, "--rerun") if is_file else None
    return tuple(path for path in (bag, rerun) if path is not None)
