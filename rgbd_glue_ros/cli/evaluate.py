"""``rgbd-glue evaluate``: the errors of a trajectory."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rgbd_glue_ros.cli.arguments import path
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.replay.result_names import ODOMETRY, TRAJECTORY
from rgbd_glue_ros.files.writing import json_text

if TYPE_CHECKING:
    from rgbd_glue_ros.evaluation.trajectory_errors import Evaluation

# GROUND_TRUTH of recordings/tum.py, which takes too long to load for a help text
_GROUND_TRUTH = "groundtruth.txt"
ESTIMATES = (TRAJECTORY, ODOMETRY, _GROUND_TRUTH)
REFERENCES = (_GROUND_TRUTH, TRAJECTORY)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Two trajectories."""
    parser.add_argument(
        "estimate",
        metavar="EST",
        type=path,
        help="trajectory: lines of a stamp and a pose, as in TUM (x y z qx qy qz qw), EuRoC (CSV, "
        "nanoseconds, qw first), in any order with a line of names, or a stamp and a matrix; or a "
        f"folder with {ESTIMATES[0]}, as of a replay",
    )
    parser.add_argument(
        "reference",
        metavar="REF",
        type=path,
        help=f"ground-truth trajectory, in the same formats, or a folder with {REFERENCES[0]}",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(args: argparse.Namespace) -> str:
    """Evaluates and returns a table or JSON."""
    from rgbd_glue_ros.evaluation.trajectory_errors import evaluate
    from rgbd_glue_ros.trajectories.tum import read_tum

    estimate = _file(args.estimate, ESTIMATES, "trajectory")
    reference = _file(args.reference, REFERENCES, "ground truth")
    evaluation = evaluate(read_tum(estimate), read_tum(reference))
    return _json(evaluation) if args.json else _table(evaluation)


def _file(path: Path, names: Sequence[str], what: str) -> Path:
    """A file, or the first of some names in a folder."""
    if not path.is_dir():
        return path
    found = next((path / name for name in names if (path / name).is_file()), None)
    if found is None:
        raise InputError(path, f"holds no {what} ({', '.join(names)})", "give the file")
    return found


def _json(evaluation: Evaluation) -> str:
    from rgbd_glue_ros.evaluation.trajectory_errors import error_figures

    return json_text({"poses": len(evaluation.stamps_ns), **error_figures(evaluation)})


def _table(evaluation: Evaluation) -> str:
    from rgbd_glue_ros.evaluation.trajectory_errors import NO_RPE

    ape, rpe = evaluation.ape, evaluation.rpe
    rows = [
        f"{len(evaluation.stamps_ns)} poses, paired one-to-one by time",
        "APE, SE(3) aligned (m)",
        f"  rmse    {ape.rmse_m:.6f}",
        f"  mean    {ape.mean_m:.6f}",
        f"  median  {ape.median_m:.6f}",
        f"  max     {ape.max_m:.6f}",
    ]
    if rpe is None:
        rows.append(f"RPE: none, since {NO_RPE}")
    else:
        rows += [
            f"RPE over {rpe.delta_s:g} s, rmse",
            f"  translation  {rpe.trans_rmse_m:.6f} m",
            f"  rotation     {rpe.rot_rmse_deg:.6f} deg",
        ]
    return "\n".join(rows) + "\n"
