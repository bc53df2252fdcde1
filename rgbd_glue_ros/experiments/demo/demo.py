"""The demonstration: a recorded camera in one process, the node in another, DDS between them."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.experiments.demo.node_process import NodeProcess, private_domain, ros_environment
from rgbd_glue_ros.experiments.demo.played import Played, transport
from rgbd_glue_ros.experiments.replay.replay import INTERRUPTED, results_of, write_results
from rgbd_glue_ros.experiments.replay.result_names import LOG, TRAJECTORY
from rgbd_glue_ros.experiments.replay.run_record import Run
from rgbd_glue_ros.experiments.replay.thumbnails import thumbnail
from rgbd_glue_ros.files.writing import write_whole
from rgbd_glue_ros.live.frame_counts import Summary
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.parameters import (
    RECEIPT,
    Config,
    InputConfig,
    NodeConfig,
    by_current_names,
    load_preset,
    share_directory,
    unknown_parameter,
    values,
    with_values,
)
from rgbd_glue_ros.trajectories.tum import write_tum
from rgbd_glue_ros.types import NANOSECONDS, OdometryEstimate, TrackingState

if TYPE_CHECKING:
    from rgbd_glue_ros.experiments.demo.player import Player

logger = logging.getLogger(__name__)

PRESET = "live"
THUMBNAILS = 60
# Compiling for the first time takes this long on a slow machine.
READY_S = 300.0
# From the last frame to the node's last summary, which comes once per second.
LAST_WORD_S = 5.0


@dataclass(frozen=True)
class Progress:
    """Progress of the demonstration.

    Attributes:
        frames: colour images of the recording.
        played: of those published.
        poses: received.
    """

    frames: int
    played: int
    poses: int


@dataclass(frozen=True)
class DemoResult:
    """Result of the demonstration.

    Attributes:
        figures: as in ``metrics.json``.
        ready_s: from the start of the node's process until it had subscribed, seconds.
        summary: the node's final summary; None if there was none.
    """

    figures: dict[str, Any]
    ready_s: float
    summary: Summary | None


def bundled_bag() -> Path:
    """The recording that comes with the package."""
    return share_directory() / "bags" / "living_room"


def demo(
    recording: Played,
    folder: Path,
    rate: float,
    on_progress: Callable[[Progress], None],
    command: str = "",
    parameters: Mapping[str, object] = MappingProxyType({}),
    inputs: InputConfig | None = None,
) -> DemoResult:
    """Plays a recording to the node and writes the results of a replay, measured live.

    However it ends, the measurements so far are written.

    Args:
        recording: what is played.
        folder: where the results and the node's log go.
        rate: speed, 1 for that of the recording.
        on_progress: called after every frame, and while the node gets ready.
        command: the command line, for quoting in the report.
        parameters: of the node, besides those that the recording needs.
        inputs: how the recording was opened, for the record; None for the defaults.

    Raises:
        InputError: the recording, the folder or a parameter cannot be used, or the node gave no
            pose.
        MissingExtraError: ROS is not installed.
        RuntimeError: the node ended.
    """
    given = by_current_names(parameters)
    own = values(NodeConfig())
    declared = {**own, **values(Config())}
    for name in given.keys() - declared.keys():
        raise unknown_parameter(name, declared)
    if given.get("stamps") == RECEIPT:
        raise InputError(
            "stamps",
            "the node's poses are assigned to what was played by the stamps in its headers",
            "leave it out, or name the recording: rgbd-glue demo SRC --set stamps=receipt",
        )
    with_values(NodeConfig(), {name: value for name, value in given.items() if name in own})
    config = with_values(
        load_preset(PRESET), {name: value for name, value in given.items() if name not in own}
    )
    of_inputs = {name: value for name, value in given.items() if name in values(InputConfig())}
    inputs = with_values(inputs or InputConfig(), of_inputs)
    with results_of(recording.name, config, folder, inputs, (LOG,)):
        node = {**_parameters(recording), **given}
        return _played_to_the_node(recording, config, folder, rate, on_progress, command, node)


def _played_to_the_node(
    recording: Played,
    config: Config,
    folder: Path,
    rate: float,
    on_progress: Callable[[Progress], None],
    command: str,
    parameters: Mapping[str, object],
) -> DemoResult:
    log = folder / LOG
    figures: dict[str, Any] = {}
    with private_domain() as domain:
        environment = ros_environment(domain)
        os.environ.update(environment)  # before ROS is loaded in this process
        try:
            from rgbd_glue_ros.experiments.demo.player import Player  # noqa: PLC0415 - ROS is optional
        except ImportError as error:
            raise MissingExtraError("rclpy", "ros", "the demonstration") from error
        start = time.monotonic()
        with (
            NodeProcess(parameters, environment) as node,
            Player(recording, domain) as player,
        ):
            noted: list[str] = []
            try:
                _wait_until_ready(
                    player, node, lambda: on_progress(Progress(recording.frame_count, 0, 0))
                )
                ready_s = time.monotonic() - start
                _play(player, recording, node, rate, on_progress)
            except KeyboardInterrupt:
                noted.append(INTERRUPTED)
                raise
            finally:
                measured = _measured(player, node)
                code = node.stop()
                write_whole(log, "\n".join(node.lines) + "\n")
                if player.unassigned:
                    logger.warning("%d poses have the stamp of no image", player.unassigned)
                if player.poses:
                    run = _run(recording, config, player, command)
                    run.warnings = [*node.warnings, *noted]
                    write_tum(folder / TRAJECTORY, run.trajectory)
                    figures = write_results(run, folder, measured)
    if code != 0:
        raise RuntimeError(f"the node ended with exit code {code}; its log is in {log}")
    if not figures:
        raise InputError(
            recording.name,
            f"the node gave no pose of it: {node.last_warning or 'it does not say why'}",
            f"its log is in {log}",
        )
    return DemoResult(figures, ready_s, player.summary)


def _parameters(recording: Played) -> dict[str, object]:
    return {
        "preset": PRESET,
        "image_transport": transport(recording, Channel.COLOR),
        "depth_transport": transport(recording, Channel.DEPTH),
        # poses as replay gives them, in the first optical frame
        "camera_axes": "optical",
    }


def _waits(player: Player, node: NodeProcess, condition: Callable[[], bool], time_s: float) -> bool:
    """Receives until ``condition`` holds; False if time is up or the node has ended."""
    return player.wait(lambda: not node.is_running or condition(), time_s) and node.is_running


def _wait_until_ready(player: Player, node: NodeProcess, on_wait: Callable[[], None]) -> None:
    def is_ready() -> bool:
        on_wait()
        return player.is_matched()

    if not _waits(player, node, is_ready, READY_S):
        node.check_refusal()
        raise RuntimeError(f"the node did not become ready: {node.last_words}")


def _play(
    player: Player,
    recording: Played,
    node: NodeProcess,
    rate: float,
    on_progress: Callable[[Progress], None],
) -> None:
    """Plays all of the recording, and waits for the node's final summary."""

    def is_done() -> bool:
        said = player.summary
        return said is not None and said.frames + sum(said.drops.values()) >= played

    played = 0
    for message in player.play(rate):
        if not node.is_running:
            raise RuntimeError(f"the node ended: {node.last_words}")
        if message.channel is Channel.COLOR:
            played += 1
            on_progress(Progress(recording.frame_count, played, len(player.poses)))
    _waits(player, node, is_done, LAST_WORD_S)
    on_progress(Progress(recording.frame_count, played, len(player.poses)))


def _run(recording: Played, config: Config, player: Player, command: str) -> Run:
    run = Run(recording.name, config, recording.ground_truth, command=command)
    for stamp in sorted(player.poses):
        estimate = OdometryEstimate(
            stamp,
            TrackingState.TRACKING,
            player.poses[stamp],
            player.covariances.get(stamp),
            is_keyframe=stamp in player.keyframes,
        )
        run.add(estimate, (player.arrived_ns[stamp] - player.published_ns[stamp]) / 1e6)
    run.unanswered_ns = tuple(sorted(player.frames_ns - player.poses.keys()))
    start, end = min(player.published_ns.values()), max(player.arrived_ns.values())
    run.wall_s = (end - start) / NANOSECONDS
    run.thumbnails = _thumbnails(recording)
    return run


def _thumbnails(recording: Played) -> dict[int, bytes]:
    """Pictures of what was played; none if the recording ends in damage."""
    try:
        return {f.stamp_ns: thumbnail(f.color) for f in recording.sample(THUMBNAILS)}
    except InputError:
        return {}


def _measured(player: Player, node: NodeProcess) -> dict[str, Any]:
    """Figures that only the node knows."""
    said = player.summary
    if said is None:
        return {}
    lost = said.frames - said.tracked
    return {
        # poses arrive at once, the summary once per second
        "frames": len(player.poses) + lost,
        "lost": lost,
        "dropped": {drop.name.lower(): n for drop, n in said.drops.items()},
        "node_latency_ms": {"p50": said.latency_p50_ms, "p95": said.latency_p95_ms},
        "peak_rss_mb": node.peak_rss_mb,
    }
