"""``rgbd-glue map``: a recording as a map."""

from __future__ import annotations

import argparse
import logging
from contextlib import ExitStack
from datetime import datetime
from pathlib import Path

from rgbd_glue_ros.cli import arguments, exports, given_parameters
from rgbd_glue_ros.cli.replay import interrupted, summary
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import FileIdentity, file_identity

logger = logging.getLogger(__name__)

OUTPUT = Path("out/map")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """A recording, parameters, output and truth."""
    arguments.add_recording(parser)
    arguments.add_config(parser)
    arguments.add_output(parser, None, f"{OUTPUT}/NAME")
    arguments.add_ground_truth(parser)
    arguments.add_limit(parser)
    exports.add_rerun(parser)
    parser.add_argument(
        "--map",
        metavar="FILE",
        type=arguments.path,
        help="map to continue, written by --save-map; poses are then in its frame",
    )
    parser.add_argument(
        "--save-map",
        metavar="FILE",
        type=arguments.path,
        help="file for the map, which --map and map_file of the mapping node read",
    )


def run(args: argparse.Namespace) -> str:
    """Builds the map and returns the figures."""
    from rgbd_glue_ros.cli.progress import tracking_bar
    from rgbd_glue_ros.experiments.mapping.mapping import MAP_RESULTS, MapOutputs, map_recording
    from rgbd_glue_ros.experiments.replay.result_names import CLOUD, REPORT, TRAJECTORY
    from rgbd_glue_ros.experiments.replay.run_warnings import heard_warnings
    from rgbd_glue_ros.slam.map_file import read_map

    config = given_parameters.config(args)
    before = read_map(args.map) if args.map else None
    folder = args.output or OUTPUT / args.recording.resolve().stem
    with (
        ExitStack() as left,
        heard_warnings() as heard,
        arguments.opened(args, args.recording) as recording,
    ):
        exports.check(args, folder, MAP_RESULTS)
        _say_what_is_replaced(args.save_map, args.map)
        replaced = file_identity(args.save_map) if args.save_map else None
        shown = exports.rerun_recording(args, recording)
        if shown is not None:
            left.enter_context(shown)
        try:
            with tracking_bar(recording.frame_count) as show:
                mapped = map_recording(
                    recording,
                    config,
                    folder,
                    before=before,
                    on_frame=show,
                    outputs=MapOutputs(args.save_map, shown, exports.files(args)),
                    provenance=arguments.provenance(args, heard),
                )
        except KeyboardInterrupt:
            logger.warning("%s; %s", _interrupted(folder), _saved(args.save_map, replaced))
            raise
    figures = mapped.figures
    loops = "{found} found, {refused} of them refused by the optimiser".format(**figures["loops"])
    text = summary(figures)
    if figures["odometry"]:
        text += f"before   {figures['odometry']['ape']['rmse_m']:.4f} m rmse (APE of odometry)\n"
    text += f"loops    {loops}\n"
    if args.save_map:
        text += f"saved    {args.save_map}\n"
    if args.rerun:
        text += f"rerun    {args.rerun}\n"
    return (
        f"{text}map      {folder / CLOUD}, {figures['map_points']} points\n"
        f"path     {folder / TRAJECTORY}\nreport   {folder / REPORT}\n"
    )


def _interrupted(folder: Path) -> str:
    """What an interrupted run has left in its folder."""
    from rgbd_glue_ros.experiments.replay.result_names import ODOMETRY, TRAJECTORY

    if (folder / TRAJECTORY).is_file():
        return f"interrupted after the loops were closed; the results are in {folder}"
    said = interrupted(folder)
    if (folder / ODOMETRY).is_file():
        said += f", of the odometry alone: no loop is closed in {ODOMETRY}, and there is no map"
    return said


def _saved(save_map: Path | None, before: FileIdentity | None) -> str:
    """Whether an interrupted run has saved its map.

    Args:
        save_map: where it should; None if nowhere.
        before: that file when the run began.
    """
    if save_map is None:
        return "no map was to be saved (--save-map)"
    if file_identity(save_map) != before:
        return f"the map is saved in {save_map}"
    left = "" if before is None else ", and the file that was there is unchanged"
    return f"the map was not saved in {save_map}{left}"


def _say_what_is_replaced(save_map: Path | None, continued: Path | None) -> None:
    """Logs which map a new one will replace; a warning, unless the new one continues it."""
    from rgbd_glue_ros.cli.progress import counted
    from rgbd_glue_ros.slam.map_file import keyframes_in

    if save_map is None or not save_map.is_file():
        return
    try:
        what = f"the map of {counted(keyframes_in(save_map), 'keyframe')}"
    except InputError:
        what = "a file that is no map of this version"
    at = f"{datetime.fromtimestamp(save_map.stat().st_mtime).astimezone():%Y-%m-%d %H:%M}"
    is_same = continued is not None and continued.resolve() == save_map.resolve()
    level = logging.INFO if is_same else logging.WARNING
    logger.log(level, "%s: replacing %s, written %s, once this one is finished", save_map, what, at)
