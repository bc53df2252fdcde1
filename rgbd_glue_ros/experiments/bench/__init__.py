"""Measures the odometry and its peers on the same recordings in one run."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from time import monotonic
from typing import Any

from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.experiments.bench.contest import OURS, Contest
from rgbd_glue_ros.experiments.bench.degraded import DegradedSequence, first
from rgbd_glue_ros.experiments.bench.floors import Floors
from rgbd_glue_ros.experiments.bench.live import Live
from rgbd_glue_ros.experiments.bench.memory import Memory
from rgbd_glue_ros.experiments.bench.page import render
from rgbd_glue_ros.experiments.bench.part import Part
from rgbd_glue_ros.experiments.bench.picture import PICTURE, picture
from rgbd_glue_ros.experiments.bench.report import PIP, to_markdown
from rgbd_glue_ros.experiments.bench.robustness import Robustness
from rgbd_glue_ros.experiments.peers import PEERS, Peer
from rgbd_glue_ros.experiments.report.machine import load, machine
from rgbd_glue_ros.files.writing import ResultFolder, json_text, write_whole
from rgbd_glue_ros.odometry.warm_up import warm_up_once
from rgbd_glue_ros.parameters import Config, values
from rgbd_glue_ros.recordings import Recording

FIGURES, TABLES, REPORT = "bench.json", "bench.md", "bench.html"

ODOMETRIES = (
    "open3d_odometry",
    "open3d_tensor_odometry",
    "opencv_rgbd_icp",
    "small_gicp",
    "colored_icp",
)
"""The default peers: those that start from the previous frame."""


@dataclass(frozen=True)
class Plan:
    """What to measure.

    Attributes:
        config: of the odometry.
        peers: names of the peers to compare with.
        limit: frames of each recording; None takes all.
        patience_s: time that each peer has for a recording, seconds.
        robustness: whether degraded recordings are measured too.
        live: whether recordings are also played to the node.
        memory_frames: number of frames for measuring memory; 0 for none.
        command: the command line, for quoting.
    """

    config: Config
    peers: Sequence[str] = ODOMETRIES
    limit: int | None = None
    patience_s: float = 120.0
    robustness: bool = False
    live: bool = False
    memory_frames: int = 0
    command: str = ""


@dataclass
class _Bench:
    """The measurements so far."""

    plan: Plan
    folder: Path
    on_part: Callable[[Part, Recording], None]
    on_frame: Callable[[], None]
    sequences: dict[str, dict[str, Any]] = field(default_factory=dict)
    memory: dict[str, Any] = field(default_factory=dict)
    not_installed: dict[str, str] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    started: float = field(default_factory=monotonic)
    begun: str = field(default_factory=lambda: f"{datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC")
    load_before: float = field(default_factory=load)

    def watch_memory(self, recording: Recording) -> None:
        """Measures memory, before anything else loads what the odometry does not need."""
        if self.plan.memory_frames:
            memory = Memory(recording, self.plan.config, self.plan.memory_frames)
            self.run(memory, recording, self.memory)

    def installed(self, name: str) -> Peer | None:
        """A peer; None, with a line that says what to install, if it is not installed."""
        try:
            return PEERS[name]()
        except MissingExtraError as error:
            self.not_installed[name] = f"{PIP} -e '.[{error.extra}]'"
        except InputError as error:
            self.not_installed[name] = error.remedy
        return None

    def compare(self, recording: Recording, peers: dict[str, Peer]) -> dict[str, Any]:
        """Measures ours, the peers and the floors; returns the figures, to be extended."""
        figures: dict[str, Any] = {}
        floors = Floors(self.plan.config)
        patience_s = self.plan.patience_s
        contest = Contest(recording, self.plan.config, peers, patience_s, floors.show)
        try:
            self.run(contest, recording, figures)
        finally:
            figures |= floors.figures()
            if figures["contest"][OURS]["frames"]:
                self.sequences[self._title(recording)] = figures
                self.write()
        return figures

    def run(self, part: Part, recording: Recording, figures: dict[str, Any]) -> None:
        self.on_part(part, recording)
        try:
            part.run(self.on_frame)
        except (InputError, MissingExtraError, RuntimeError) as error:
            self.problems.append(f"{recording.name}, {part.title}: {error}")
        finally:
            figures |= part.figures()
            self.write()

    def _title(self, recording: Recording) -> str:
        """The recording's name, numbered if others have the same."""
        name, count = recording.name, 1
        while name in self.sequences:
            count += 1
            name = f"{recording.name} ({count})"
        return name

    def figures(self) -> dict[str, Any]:
        return {
            "command": self.plan.command,
            "begun": self.begun,
            "minutes": (monotonic() - self.started) / 60,
            "machine": machine(),
            "load": [self.load_before, load()],
            "parameters": values(self.plan.config),
            "sequences": self.sequences,
            **self.memory,
            "not_installed": self.not_installed,
            "problems": self.problems,
        }

    def write(self) -> None:
        """Writes everything measured so far."""
        figures = self.figures()
        write_whole(self.folder / FIGURES, json_text(figures))
        tables = to_markdown(figures)
        write_whole(self.folder / TABLES, tables)
        drawn = picture(self.sequences, OURS)
        write_whole(self.folder / REPORT, render(tables, drawn))
        if drawn is not None:
            write_whole(self.folder / PICTURE, drawn)


def run_bench(
    sources: Sequence[Path],
    open_source: Callable[[Path], Recording],
    plan: Plan,
    folder: Path,
    *,
    on_part: Callable[[Part, Recording], None] = lambda _, __: None,
    on_frame: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Measures according to a plan; however it ends, the measurements are written.

    An unusable recording, a peer that is not installed and a node that ends are reported, the rest
    continues.

    Args:
        sources: the recordings, at least one.
        open_source: opens one.
        plan: what to measure.
        folder: where the results go; created if it is not there.
        on_part: called before every part.
        on_frame: called after every frame.

    Returns:
        The content of ``bench.json``.

    Raises:
        InputError: a peer is unknown, the folder cannot be written, or no recording is usable.
    """
    unknown = [name for name in plan.peers if name not in PEERS]
    if unknown:
        known = ", ".join(PEERS)
        raise InputError("--peer", f"there is no {', '.join(unknown)}", f"there are {known}")
    with ResultFolder(folder, (FIGURES, TABLES, REPORT, PICTURE)):
        return _measured(sources, open_source, plan, _Bench(plan, folder, on_part, on_frame))


def _measured(
    sources: Sequence[Path],
    open_source: Callable[[Path], Recording],
    plan: Plan,
    bench: _Bench,
) -> dict[str, Any]:
    unusable: list[InputError] = []

    def use(source: Path, measure: Callable[[Recording], object]) -> None:
        try:
            with open_source(source) as recording:
                limit = plan.limit
                measure(recording if limit is None else DegradedSequence(recording, first(limit)))
        except InputError as error:
            unusable.append(error)
            bench.problems.append(str(error))

    use(sources[0], bench.watch_memory)
    warm_up_once(plan.config)
    # OpenMP's threads would continue spinning in the time of the next measurement
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    peers = {name: peer for name in plan.peers if (peer := bench.installed(name)) is not None}
    compared: dict[Path, dict[str, Any]] = {}
    for source in sources:
        use(source, lambda r: compared.update({source: bench.compare(r, peers)}))  # noqa: B023
    if not bench.sequences and unusable:
        raise unusable[0]
    # slow parts come last, so that an interrupted run has something of every recording
    for part in _further_parts(plan):
        for source, figures in compared.items():
            use(source, lambda r: bench.run(part(r), r, figures))  # noqa: B023
    return bench.figures()


def _further_parts(plan: Plan) -> list[Callable[[Recording], Part]]:
    parts: list[Callable[[Recording], Part]] = []
    if plan.live:
        parts.append(lambda recording: Live(recording, plan.config))
    if plan.robustness:
        parts.append(lambda recording: Robustness(recording, plan.config))
    return parts
