"""Builds a map of a recording in a folder."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rgbd_glue_ros.closing import uninterrupted
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.trajectory_errors import error_figures, evaluated
from rgbd_glue_ros.experiments.mapping.sink import MappingSink
from rgbd_glue_ros.experiments.replay.outputs import FurtherOutputs
from rgbd_glue_ros.experiments.replay.places import check_places
from rgbd_glue_ros.experiments.replay.replay import (
    replay_into,
    results_of,
    write_results,
)
from rgbd_glue_ros.experiments.replay.result_names import CLOUD, ODOMETRY, RESULTS, TRAJECTORY
from rgbd_glue_ros.experiments.replay.run_record import Provenance, Run
from rgbd_glue_ros.experiments.replay.sinks import LeftOpen
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.recordings import Recording
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam.appearance import SearchTree
from rgbd_glue_ros.slam.cloud import ColoredCloud, fused, write_ply
from rgbd_glue_ros.slam.correction import corrected
from rgbd_glue_ros.slam.loop_finder import LoopFinder
from rgbd_glue_ros.slam.map_file import SavedMap, write_map
from rgbd_glue_ros.slam.mapper import Mapper
from rgbd_glue_ros.slam.optimiser import Optimum, load_gtsam
from rgbd_glue_ros.slam.picture import map_jpeg
from rgbd_glue_ros.stopwatch import timed
from rgbd_glue_ros.trajectories.tum import write_tum
from rgbd_glue_ros.types import (
    EdgeOrigin,
    OdometryEstimate,
    PoseGraphEdge,
    Trajectory,
)
from rgbd_glue_ros.viz.rerun_recording import RerunRecording

UNCORRECTED = (
    f"No loop is closed: path ({ODOMETRY}) and figures are those of the odometry alone, and there "
    "is no map."
)
"""In the report until the map is finished."""

MAP_RESULTS = (*RESULTS, ODOMETRY, CLOUD)
"""What is written to the folder."""


@dataclass(frozen=True)
class MappedRun:
    """Result of mapping a recording.

    Attributes:
        run: its frames at their optimum, and the edges of loops.
        optimum: of the pose graph.
        cloud: the clouds of its keyframes at their optimum.
        figures: as in ``metrics.json``.
    """

    run: Run
    optimum: Optimum
    cloud: ColoredCloud
    figures: dict[str, Any]


@dataclass(frozen=True)
class MapOutputs:
    """Outputs that a mapping has only if they are asked for.

    Attributes:
        save_map: file to write the map to, for other sessions; None writes none.
        shown: receives everything for the Rerun viewer, and stays open; None for none.
        files: what that writes.
    """

    save_map: Path | None = None
    shown: RerunRecording | None = None
    files: tuple[Path, ...] = ()


def map_recording(
    sequence: Recording,
    config: Config,
    folder: Path,
    *,
    before: SavedMap | None = None,
    on_frame: Callable[[OdometryEstimate], None] = lambda _: None,
    outputs: MapOutputs = MapOutputs(),
    provenance: Provenance = Provenance(),
) -> MappedRun:
    """Runs the odometry, closes loops, and writes the corrected results.

    The results of a replay are there as soon as the odometry is done, and say that no loop is
    closed in them; they are then replaced by the corrected ones. The odometry's own trajectory is
    ``odometry.txt`` from the first pose on: ``trajectory.txt`` is corrected, or is not there.

    Args:
        sequence: source of the frames.
        config: of the odometry.
        folder: where the results go; created if it is not there.
        before: a map to continue; None starts a new one.
        on_frame: called after each frame.
        outputs: what is written besides the folder.
        provenance: how the run came about, for the record.

    Raises:
        InputError: the folder or the map cannot be written, a frame cannot be read, or the
            recording shows no place of the existing map.
        MissingExtraError: the libraries of the extra slam are not installed.
    """
    load_gtsam()
    check_places(folder, MAP_RESULTS, {"save_map": outputs.save_map})
    # learned features have networks, which are loaded once
    glue = Glue(config)
    odometry = Odometry(config, glue)
    sink, shown = MappingSink(odometry, partial(_new_mapper, config, glue, before)), outputs.shown
    names = (ODOMETRY, CLOUD)
    beside = (*outputs.files, outputs.save_map)
    with (
        results_of(sequence.name, config, folder, provenance.inputs, names, beside) as results,
        ExitStack() as end,
    ):
        run = replay_into(
            results,
            sequence,
            config,
            on_frame=on_frame,
            outputs=FurtherOutputs([sink] if shown is None else [sink, LeftOpen(shown)]),
            odometry=odometry,
            provenance=replace(provenance, warnings=(*provenance.warnings, UNCORRECTED)),
            trajectory=ODOMETRY,
        )
        # an interrupt inside of GTSAM is a crash, and the rest takes seconds
        end.enter_context(uninterrupted())
        return _optimised(run, sink, folder, outputs)


@uninterrupted()
def _new_mapper(config: Config, glue: Glue, before: SavedMap | None) -> Mapper:
    mapper = Mapper(LoopFinder(config, glue, SearchTree))
    if before is not None:
        mapper.restore(before)
    return mapper


def _optimised(whole: Run, sink: MappingSink, folder: Path, outputs: MapOutputs) -> MappedRun:
    """Optimises the longest part of a run, and replaces its results in the folder."""
    part, mapped_part = whole.longest_part, sink.longest(whole)
    mapper = mapped_part.mapper
    write_tum(folder / ODOMETRY, part.trajectory)
    try:
        optimum, finish_ms = timed(mapper.finish)
    except InputError as error:
        # such as a map that shows no place of the recording
        whole.warnings.append(f"There is no map: {error.where}: {error.cause}")
        write_results(whole, folder)
        remedy = f"{error.remedy}; in {folder} are the results of the odometry alone ({ODOMETRY})"
        raise InputError(error.where, error.cause, remedy) from error
    whole.warnings.remove(UNCORRECTED)
    mapped = _mapped(part, mapper, optimum)
    write_tum(folder / TRAJECTORY, mapped.trajectory)
    if outputs.shown is not None:
        outputs.shown.correct(mapped.trajectory, mapped.pose_graph, _keyframes_before(whole))
    cloud = fused(mapped_part.clouds, optimum.graph.keyframes.poses[mapper.session_start :])
    write_ply(folder / CLOUD, cloud)
    mapped = replace(mapped, map_jpeg=map_jpeg(cloud, mapped.trajectory.poses))
    measured = {
        "odometry": _errors(part),
        "loops": _loops(optimum),
        "mapping_ms": {"keyframe_p50": float(np.median(sink.ms)), "finish": finish_ms},
        "map_points": len(cloud),
        **_of_the_whole(whole),
    }
    # the recording's own part of a continued map is at no optimum without the rest
    figures = write_results(mapped, folder, measured, optimum.accepted)
    # the largest comes last: on a disk that it fills, the others are of one state
    if outputs.save_map is not None:
        write_map(outputs.save_map, mapped_part.saved(optimum.graph))
    return MappedRun(mapped, optimum, cloud, figures)


def _of_the_whole(run: Run) -> dict[str, Any]:
    """Figures of a run of which a part is mapped."""
    return {
        "played": len(run.frames),
        "fps": len(run.frames) / run.wall_s,
        "restarts": len(run.restarts),
    }


def _keyframes_before(run: Run) -> int:
    """How many keyframes there are before the longest part of a run."""
    before = run.parts[: run.longest_row]
    return sum(len(part.pose_graph.keyframes) for part in before)


def _mapped(run: Run, mapper: Mapper, optimum: Optimum) -> Run:
    """The run with every pose at its optimum, and with its own loops."""
    start = mapper.session_start
    keyframes = mapper.keyframes[start:]
    stamps = optimum.graph.keyframes.stamps_ns[start:]
    before = Trajectory(stamps, np.array([keyframe.T_odom_camera for keyframe in keyframes]))
    after = Trajectory(stamps, optimum.graph.keyframes.poses[start:])
    moved = corrected(run.trajectory, before, after)
    poses = dict(zip(moved.stamps_ns.tolist(), moved.poses, strict=True))
    frames = [replace(f, T_odom_camera=poses.get(f.stamp_ns)) for f in run.frames]
    loops = (
        replace(edge, parent=edge.parent - start, child=edge.child - start)
        for edge in believed_loops(optimum)
        if edge.parent >= start
    )
    frames[-1] = replace(frames[-1], edges=(*frames[-1].edges, *loops))
    return replace(run, frames=frames, uncorrected=run.trajectory)


def believed_loops(optimum: Optimum) -> tuple[PoseGraphEdge, ...]:
    """The loops that the optimum accepts."""
    return tuple(edge for edge in optimum.accepted.edges if edge.origin is EdgeOrigin.LOOP)


def _loops(optimum: Optimum) -> dict[str, Any]:
    found = sum(edge.origin is EdgeOrigin.LOOP for edge in optimum.graph.edges)
    believed = len(believed_loops(optimum))
    degrees = optimum.degrees_of_freedom
    return {
        "found": found,
        "refused": found - believed,
        "chi2_per_dof": optimum.chi_squared / degrees if degrees > 0 else None,
    }


def _errors(run: Run) -> dict[str, Any] | None:
    """APE and RPE before loops were closed; None without ground truth."""
    evaluation = evaluated(run.trajectory, run.ground_truth)
    return None if evaluation is None else error_figures(evaluation)
