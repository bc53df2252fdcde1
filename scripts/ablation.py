"""What each part of the method contributes to the odometry: what it does without it.

``python scripts/ablation.py RECORDING... --every 1 --every 5`` takes the parts away one by one and
prints a table for each rate; ``--features xfeat+fpfh_grid`` compares features in their place.
``--set`` changes a parameter of all rows.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any
from unittest.mock import patch

import numpy as np

from rgbd_glue_ros import Odometry, Trajectory, evaluate, load_preset, open_recording
from rgbd_glue_ros.experiments.bench.degraded import every
from rgbd_glue_ros.experiments.report.markdown import NOTHING, table
from rgbd_glue_ros.odometry import tracking
from rgbd_glue_ros.odometry.candidates import turned_candidates
from rgbd_glue_ros.odometry.pose_choice import Candidate, choose
from rgbd_glue_ros.odometry.warm_up import warm_up
from rgbd_glue_ros.parameters import Config, with_values
from rgbd_glue_ros.parameters.files import parse_assignment

WITHOUT: Mapping[str, Mapping[str, Any]] = {
    "whole": {},
    "no visual features": {"features.visual": "none"},
    "no geometric features": {"features.geometric": "none"},
    "no filter": {"glue.filter": False},
    "no refinement": {"refine.iterations": 0},
    "no prediction": {"odometry.prior_radius": 0.0},
}
"""Parts of the method by what switches them off."""


@dataclass
class Decisions:
    """How poses of frames were found.

    Attributes:
        same: prediction and registration led to one pose, or only one of the two gave any.
        prediction: they differed, and the pose that refinement reached from the prediction won.
        registration: they differed, and the one from the registration won.
        turn: none was clear, and the one from where the whole image has turned to won.
    """

    same: int = 0
    prediction: int = 0
    registration: int = 0
    turn: int = 0


@dataclass
class Outcome:
    """What came of a recording.

    Attributes:
        frames: that were tracked.
        lost: of them, without a pose.
        ape_cm: root mean square, aligned; NaN where fewer than three have a pose.
        rpe_cm: over a second; NaN where there is none.
        milliseconds: median processor time of a frame, all threads together.
        decisions: how poses were found.
    """

    frames: int = 0
    lost: int = 0
    ape_cm: float = float("nan")
    rpe_cm: float = float("nan")
    milliseconds: float = float("nan")
    decisions: Decisions = field(default_factory=Decisions)

    def __str__(self) -> str:
        if np.isnan(self.ape_cm):
            return f"lost ({self.lost} of {self.frames})"
        return f"{self.ape_cm:.2f}" + (f" ({self.lost} lost)" if self.lost else "")


def watched(decisions: Decisions) -> AbstractContextManager[Any]:
    """Counts which of a frame's poses are chosen, while it lasts."""
    turned: list[Candidate] = []

    def found(*arguments: Any) -> list[Candidate]:
        turned[:] = turned_candidates(*arguments)
        return turned

    def counted(candidates: Sequence[Candidate], *arguments: Any) -> Candidate | None:
        chosen = choose(candidates, *arguments)
        if any(chosen is candidate for candidate in turned):
            decisions.turn += 1
        elif chosen is not None and len(candidates) == 1:
            decisions.same += 1
        elif chosen is not None and chosen is candidates[0]:
            decisions.prediction += 1
        elif chosen is not None:
            decisions.registration += 1
        return chosen

    return patch.multiple(tracking, choose=counted, turned_candidates=found)


def tracked(path: Path, config: Config, step: int) -> Outcome:
    """Every so many frames of a recording by a configuration."""
    outcome = Outcome()
    stamps, poses, times = [], [], []
    with (
        open_recording(path) as recording,
        Odometry(config) as odometry,
        watched(outcome.decisions),
    ):
        truth = recording.ground_truth
        for frame in recording.select(range(0, recording.frame_count, step)):
            start = process_time()
            estimate = odometry.process(frame)
            times.append(1000 * (process_time() - start))
            outcome.frames += 1
            if estimate.T_odom_camera is None:
                outcome.lost += 1
                continue
            stamps.append(estimate.stamp_ns)
            poses.append(estimate.T_odom_camera)
    outcome.milliseconds = median(times)
    if truth is not None and len(poses) >= 3:
        errors = evaluate(Trajectory(np.array(stamps), np.array(poses)), truth)
        outcome.ape_cm = 100 * errors.ape.rmse_m
        if errors.rpe is not None:
            outcome.rpe_cm = 100 * errors.rpe.trans_rmse_m
    return outcome


def compared(
    recordings: Sequence[Path], rows: Mapping[str, Config], step: int
) -> dict[str, list[Outcome]]:
    """The outcomes of every configuration, by row."""
    outcomes: dict[str, list[Outcome]] = {}
    for name, config in rows.items():
        warm_up(config)
        outcomes[name] = []
        for path in recordings:
            outcomes[name].append(tracked(path, config, step))
            print(f"{rate(step)}  {name}  {path.name}  {outcomes[name][-1]}", file=sys.stderr)
    return outcomes


def errors_table(names: Sequence[str], outcomes: Mapping[str, Sequence[Outcome]]) -> str:
    """A row for each configuration, a column for each recording; APE in cm, and frames lost."""
    rows = []
    for name, row in outcomes.items():
        times = f"{median(outcome.milliseconds for outcome in row):.0f}"
        rows.append([name, *map(str, row), times])
    return table(["", *names, "ms per frame"], rows)


def decisions_table(names: Sequence[str], outcomes: Sequence[Outcome]) -> str:
    """How many of the frames of each recording got their pose in which way."""
    rows = []
    for name, outcome in zip(names, outcomes, strict=True):
        counts = outcome.decisions
        rows.append([name, *map(str, vars(counts).values())])
    return table(["", "the same", "refined prediction", "registration", "turn"], rows)


def drift_table(names: Sequence[str], outcomes: Mapping[str, Sequence[Outcome]]) -> str:
    """RPE over a second in cm, a row for each configuration."""
    rows = [
        [name, *(NOTHING if np.isnan(o.rpe_cm) else f"{o.rpe_cm:.2f}" for o in row)]
        for name, row in outcomes.items()
    ]
    return table(["", *names], rows)


def rate(step: int) -> str:
    """Which frames were tracked, at the beginning of a line."""
    return "Every frame" if step == 1 else every(step).name.capitalize()


def main() -> None:
    """Measures, and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", metavar="RECORDING", nargs="+", type=Path)
    parser.add_argument("--every", metavar="N", type=int, action="append")
    parser.add_argument("--features", metavar="VISUAL+GEOMETRIC", action="append")
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[])
    args = parser.parse_args()
    base = with_values(load_preset("live"), dict(map(parse_assignment, args.set)))
    changes: Mapping[str, Mapping[str, Any]] = WITHOUT
    if args.features:
        parts = {name: name.partition("+") for name in args.features}
        changes = {
            name: {"features.visual": visual, "features.geometric": geometric}
            for name, (visual, _, geometric) in parts.items()
        }
    rows = {name: with_values(base, dict(change)) for name, change in changes.items()}
    names = [path.name for path in args.recordings]
    for step in args.every or [1]:
        outcomes = compared(args.recordings, rows, step)
        print(f"{rate(step)}, APE in cm (frames lost):\n")
        print(errors_table(names, outcomes), end="\n\n")
        print(f"{rate(step)}, RPE over a second in cm:\n")
        print(drift_table(names, outcomes), end="\n\n")
        if "whole" in outcomes:
            print(f"{rate(step)}, frames by the pose that was chosen:\n")
            print(decisions_table(names, outcomes["whole"]), end="\n\n")


if __name__ == "__main__":
    main()
