"""Replays a recording through the odometry and writes the results to a folder."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType
from typing import Any

from rgbd_glue_ros.closing import uninterrupted
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.trajectory_errors import Evaluation, evaluate
from rgbd_glue_ros.experiments.replay.earlier_results import (
    recording_of,
    say_what_is_replaced,
    stale_files,
)
from rgbd_glue_ros.experiments.replay.frame_loop import FrameLoop
from rgbd_glue_ros.experiments.replay.keyframe_clouds import KeyframeClouds
from rgbd_glue_ros.experiments.replay.outputs import FurtherOutputs
from rgbd_glue_ros.experiments.replay.places import check_places
from rgbd_glue_ros.experiments.replay.report import render
from rgbd_glue_ros.experiments.replay.result_names import (
    KEYFRAMES,
    KEYFRAMES_GTSAM,
    METRICS,
    PARAMETERS,
    REPORT,
    RESULTS,
    TRAJECTORY,
)
from rgbd_glue_ros.experiments.replay.run_record import FrameRecord, Provenance, Run, metrics
from rgbd_glue_ros.experiments.replay.run_warnings import heard_warnings
from rgbd_glue_ros.experiments.replay.thumbnails import Thumbnails
from rgbd_glue_ros.experiments.report.colophon import Colophon
from rgbd_glue_ros.files.writing import ResultFolder, json_text, write_whole
from rgbd_glue_ros.live.imu_faults import explain_distrust
from rgbd_glue_ros.odometry.depth_diagnosis import explain_no_pose
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.odometry.warm_up import warm_up_once
from rgbd_glue_ros.parameters import Config, InputConfig, to_yaml
from rgbd_glue_ros.printable import counted
from rgbd_glue_ros.recordings import Recording, imu_of, refuse_recording
from rgbd_glue_ros.recordings.depth_topic import depth_topic
from rgbd_glue_ros.recordings.left_out import left_out_of
from rgbd_glue_ros.slam.cloud import write_ply
from rgbd_glue_ros.slam.picture import map_jpeg
from rgbd_glue_ros.trajectories.pose_graph import GraphReader, write_graph
from rgbd_glue_ros.trajectories.tum import TumWriter
from rgbd_glue_ros.types import (
    NANOSECONDS,
    ImuSamples,
    OdometryEstimate,
    PoseGraph,
)

logger = logging.getLogger(__name__)

INTERRUPTED = "The run was interrupted: these are the frames until then."


def replay(
    sequence: Recording,
    config: Config,
    folder: Path,
    *,
    on_frame: Callable[[OdometryEstimate], None] = lambda _: None,
    outputs: FurtherOutputs = FurtherOutputs(),
    provenance: Provenance = Provenance(),
) -> Run:
    """Runs the odometry over ``sequence`` as fast as possible; no frame is dropped.

    Poses are on disk as soon as they are known. However the run ends, the results of the processed
    frames are written.

    Args:
        sequence: source of the frames.
        config: of the odometry.
        folder: where the results go; created if it is not there.
        on_frame: called after each frame.
        outputs: what is written besides the folder.
        provenance: how the run came about, for the record.

    Raises:
        InputError: the folder or the cloud cannot be written, another run is writing to it, a
            frame cannot be read, or none was tracked.
    """
    check_places(folder, RESULTS, {"cloud": outputs.cloud})
    beside = (*outputs.files, outputs.cloud)
    with results_of(sequence.name, config, folder, provenance.inputs, (), beside) as results:
        return replay_into(
            results,
            sequence,
            config,
            on_frame=on_frame,
            outputs=outputs,
            provenance=provenance,
        )


def replay_into(
    results: ResultFolder,
    sequence: Recording,
    config: Config,
    *,
    on_frame: Callable[[OdometryEstimate], None] = lambda _: None,
    outputs: FurtherOutputs = FurtherOutputs(),
    odometry: Odometry | None = None,
    provenance: Provenance = Provenance(),
    trajectory: str = TRAJECTORY,
) -> Run:
    """Like ``replay``, into a folder that the caller continues to write to.

    Args:
        results: the folder.
        sequence: source of the frames.
        config: of the odometry.
        on_frame: called after each frame.
        outputs: what is written besides the folder.
        odometry: a new one of ``config``, for access by the caller; None creates one. It is finally
            closed.
        provenance: how the run came about, for the report.
        trajectory: name of the file for the poses, as soon as they are known.
    """
    folder = results.path
    warm_up_once(config)
    run = Run(sequence.name, config, sequence.ground_truth, command=provenance.command)
    run.warnings.extend(provenance.warnings)
    pictures, clouds = Thumbnails(), KeyframeClouds()
    takers = (pictures, *(() if outputs.cloud is None else (clouds,)), *outputs.sinks)
    odometry = odometry or Odometry(config)
    imu = imu_of(sequence) or ImuSamples.empty()
    last: OdometryEstimate | None = None
    with heard_warnings(run.warnings):
        try:
            with TumWriter(folder / trajectory) as poses, odometry:
                frames = FrameLoop(run, odometry, imu, poses, takers, on_frame)
                for frame in sequence:
                    frames.take(frame)
                last = frames.last
            _warn_of_imu(odometry)
            _warn_of_restarts(run)
            _warn_of_blind_restarts(run)
            _warn_of_unseen_motion(run)
            why_none = ""
            if last is not None and len(run.trajectory) == 0:
                why_none = explain_no_pose(last, config.camera, depth_topic(sequence))
                run.warnings.append(f"No frame was tracked: {why_none}")
        except InputError as error:
            run.warnings.append(f"The run ended early: {error.where}: {error.cause}")
            raise _after_frames(error, len(run.frames)) from error
        except KeyboardInterrupt:
            run.warnings.append(INTERRUPTED)
            raise
        finally:
            with uninterrupted(), ExitStack() as left:
                left_out = left_out_of(sequence)
                run.duplicates += left_out.duplicates
                run.unpaired = left_out.unpaired
                for sink in outputs.sinks:
                    left.callback(sink.close)
                if run.frames:
                    run.thumbnails = pictures.jpegs
                    left.callback(write_results, run, folder)
                    _leave_cloud(left, outputs.cloud, clouds, run)
    if not run.frames:
        raise InputError(sequence.name, "holds no frames", "give a recording with RGB-D frames")
    if last is not None and len(run.trajectory) == 0:
        raise InputError(
            sequence.name,
            f"none of its {len(run.frames)} frames was tracked: {why_none}",
            f"the report on them is in {folder}",
        )
    return run


def _after_frames(error: InputError, count: int) -> InputError:
    """A fault of a recording, with the number of frames processed before it."""
    done = f"; the {count} frames before it are processed" if count else ""
    return InputError(error.where, error.cause, error.remedy + done)


def _leave_cloud(left: ExitStack, file: Path | None, clouds: KeyframeClouds, run: Run) -> None:
    """Adds a picture of the keyframes' cloud to the run, and writes the file."""
    if file is not None:
        seen = clouds.longest(run)
        left.callback(write_ply, file, seen)
        run.map_jpeg = map_jpeg(seen, run.longest_part.trajectory.poses)


def _warn_of_restarts(run: Run) -> None:
    if run.restarts:
        logger.warning(
            "%s: time went back (a bag in a loop?), and the odometry started anew, in an odom "
            "frame of its own. Of %d parts, errors, pose graph and report are of the longest, "
            "%d of %d frames",
            *(run.sequence, len(run.parts), len(run.longest_part.frames), len(run.frames)),
        )


def _warn_of_blind_restarts(run: Run) -> None:
    restarts = run.blind_restarts
    if restarts:
        logger.warning(
            "%s: lost and not recognised again %s, the first time at %.3f s: the odometry "
            "restarted at the last pose, which may be %.1f m off, and so may all that follows",
            *(run.sequence, counted(len(restarts), "time")),
            *_first_s_and_most_off_m(restarts),
        )


def _warn_of_unseen_motion(run: Run) -> None:
    unseen = run.unseen_motion
    if unseen:
        logger.warning(
            "%s: %s, the first at %.3f s, did not show all of the motion, as at a bare "
            "wall: their poses may be %.1f m off, and so may all that follows",
            *(run.sequence, counted(len(unseen), "frame")),
            *_first_s_and_most_off_m(unseen),
        )


def _first_s_and_most_off_m(frames: Sequence[FrameRecord]) -> tuple[float, float]:
    """The stamp of the first, seconds, and how far off any of their poses may be, metres."""
    return frames[0].stamp_ns / NANOSECONDS, max(frame.position_m or 0.0 for frame in frames)


def _warn_of_imu(odometry: Odometry) -> None:
    distrust = explain_distrust(odometry.imu_calibration)
    if distrust is not None:
        logger.warning("imu: %s", distrust)


def results_of(
    name: str,
    config: Config,
    folder: Path,
    inputs: InputConfig,
    further: Sequence[str] = (),
    beside: Collection[Path | None] = (),
) -> ResultFolder:
    """The folder for the results of a recording, with what is known before the first frame.

    Args:
        name: of the recording.
        config: of the odometry.
        folder: created if it does not exist; results in it are removed.
        inputs: how the recording was opened.
        further: names of further files besides the results of a replay.
        beside: files and folders that the run writes beside these, maybe into the folder; None
            stands for one that is not asked for.

    Raises:
        InputError: the folder cannot be written, is a recording, or another run is writing to it.
    """
    refuse_recording(folder)
    before = recording_of(folder / METRICS)
    names = (*RESULTS, *further)
    results = ResultFolder(folder, names)
    say_what_is_replaced(folder, before, name, stale_files(folder, names, beside))
    write_whole(folder / PARAMETERS, to_yaml(inputs, config))
    return results


@uninterrupted()
def write_results(
    run: Run,
    folder: Path,
    measured: Mapping[str, Any] = MappingProxyType({}),
    graph: PoseGraph | None = None,
) -> dict[str, Any]:
    """Writes figures, report and pose graph of a run with at least one frame.

    Where the odometry started anew, report, errors and pose graph are of the longest part.

    Args:
        run: the run.
        folder: destination.
        measured: figures measured elsewhere, in addition to those of the run or replacing them.
        graph: the pose graph; None for the one that the odometry measured.

    Returns:
        The figures written.
    """
    # of one time, and in one odom frame
    part = run.longest_part
    evaluation, why_none = _evaluation(part)
    figures = {**metrics(run, evaluation), **measured}
    if why_none:
        figures["no_ape"] = why_none
    graph = part.pose_graph if graph is None else graph
    write_graph(folder / KEYFRAMES, graph, GraphReader.G2O)
    write_graph(folder / KEYFRAMES_GTSAM, graph, GraphReader.GTSAM)
    write_whole(folder / METRICS, json_text(figures))
    colophon = Colophon.now(run.command, run.sequence)
    write_whole(folder / REPORT, render(part, figures, evaluation, colophon))
    return figures


def _evaluation(run: Run) -> tuple[Evaluation | None, str]:
    """The errors; None, and why, if there is ground truth that does not give them."""
    # without any pose, why there is none is said elsewhere
    if run.ground_truth is None or not len(run.trajectory):
        return None, ""
    try:
        return evaluate(run.trajectory, run.ground_truth), ""
    except InputError as error:
        logger.warning("%s: no error against ground truth: %s", run.sequence, error.cause)
        return None, error.cause
