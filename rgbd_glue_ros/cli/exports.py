"""Outputs of ``replay`` and ``map`` for other programs."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rgbd_glue_ros.cli import arguments
from rgbd_glue_ros.errors import InputError

if TYPE_CHECKING:
    from rgbd_glue_ros.experiments.replay.sinks import FrameSink
    from rgbd_glue_ros.recordings import Recording
    from rgbd_glue_ros.types import Trajectory
    from rgbd_glue_ros.viz.rerun_recording import RerunRecording


def add_rerun(parser: argparse.ArgumentParser) -> None:
    """``--rerun``."""
    parser.add_argument(
        "--rerun",
        metavar="FILE.rrd",
        help="write images, scene, matches and plots for the Rerun viewer (extra viz), or show "
        "them in a running one: rerun+http://127.0.0.1:9876/proxy",
    )


def rerun_recording(
    args: argparse.Namespace, recording: Recording, truth: Trajectory | None
) -> RerunRecording | None:
    """The recording requested by ``--rerun``.

    Raises:
        InputError: it cannot be written.
        MissingExtraError: Rerun is not installed.
    """
    from rgbd_glue_ros.viz.rerun_recording import RerunRecording

    return RerunRecording(args.rerun, truth or recording.ground_truth) if args.rerun else None


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


def check_beside(folder: Path, further: Mapping[str, Path | None]) -> None:
    """Looks before a run whether what goes elsewhere can be there beside the folder of results.

    Args:
        folder: of the results, which is made if it is not there.
        further: by option, where else something is to be written; None where it is not asked for.

    Raises:
        InputError: one is the folder, or a folder around it.
    """
    results = folder.resolve()
    for option, path in further.items():
        if path is not None and path.resolve() in (results, *results.parents):
            raise InputError(
                f"{option} {path}", f"is where the results go (-o {folder})", "give another place"
            )


def sinks(
    args: argparse.Namespace, recording: Recording, truth: Trajectory | None
) -> list[FrameSink]:
    """The outputs requested by the arguments of ``add_exports``.

    Args:
        args: as parsed.
        recording: the replayed recording.
        truth: its true trajectory; None uses the recording's own.

    Raises:
        InputError: it cannot be written.
        MissingExtraError: a library is not installed.
    """
    from rgbd_glue_ros.experiments.replay.bag_sink import BagSink

    asked: list[FrameSink] = []
    if args.mcap:
        asked.append(BagSink(args.mcap))
    shown = rerun_recording(args, recording, truth)
    return asked if shown is None else [*asked, shown]
