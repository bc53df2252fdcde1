"""APE and RPE: closed forms, invariances, and the same figures as evo's programs."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs.trajectories import line, wandering

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.trajectory_errors import Rpe, error_figures, evaluate, evaluated
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.trajectories.tum import read_tum, write_tum
from rgbd_glue_ros.types import (
    NANOSECONDS,
    Float64,
    Trajectory,
)

SECOND = NANOSECONDS


def disturbed(trajectory: Trajectory, seed: int, amount: float = 0.005) -> Trajectory:
    rng = np.random.default_rng(seed)
    noise = np.stack([se3.exp(rng.normal(0, amount, 6)) for _ in range(len(trajectory))])
    return Trajectory(trajectory.stamps_ns, trajectory.poses @ noise)


def test_a_trajectory_has_no_error_against_itself() -> None:
    result = evaluate(wandering(0), wandering(0))
    assert result.ape.max_m < 1e-12
    assert result.rpe is not None
    assert result.rpe.trans_rmse_m < 1e-12
    assert result.rpe.rot_rmse_deg < 1e-5


@pytest.mark.parametrize("difference_s", [np.nan, np.inf, -0.1, 1e300])
def test_a_difference_that_is_no_time_is_refused(difference_s: float) -> None:
    with pytest.raises(InputError, match=r"max_difference_s: is .*; give seconds, such as 0.02"):
        evaluate(line(0.5), line(0.5), difference_s)


def test_relative_error_of_a_false_speed_is_that_speed_times_one_second() -> None:
    rpe = evaluate(line(0.55), line(0.5)).rpe
    assert rpe is not None
    assert rpe.trans_rmse_m == pytest.approx(0.05, abs=1e-9)
    assert rpe.rot_rmse_deg == pytest.approx(0.0, abs=1e-9)


def test_absolute_error_of_two_straight_lines_is_that_of_their_lengths() -> None:
    # after alignment the middles agree, and errors grow to both ends as |x - x_mean|
    fast, slow = line(0.55), line(0.5)
    expected = np.abs(0.05 * np.arange(90) / 30 - 0.05 * 89 / 60)
    ape = evaluate(fast, slow).ape
    assert ape.max_m == pytest.approx(expected.max(), abs=1e-8)
    assert ape.mean_m == pytest.approx(expected.mean(), abs=1e-8)
    assert ape.median_m == pytest.approx(np.median(expected), abs=1e-8)
    assert ape.rmse_m == pytest.approx(np.sqrt((expected**2).mean()), abs=1e-8)


@given(st.integers(0, 2**31), st.lists(st.floats(-3, 3), min_size=6, max_size=6))
@settings(max_examples=25, deadline=None)
def test_errors_do_not_change_when_the_estimate_is_moved_as_a_whole(
    seed: int, twist: list[float]
) -> None:
    true = wandering(seed)
    estimate = disturbed(true, seed + 1)
    moved = Trajectory(estimate.stamps_ns, se3.exp(np.array(twist)) @ estimate.poses)
    one, other = evaluate(estimate, true), evaluate(moved, true)
    assert other.ape.rmse_m == pytest.approx(one.ape.rmse_m, rel=1e-6)
    assert one.rpe is not None
    assert other.rpe is not None
    assert other.rpe.trans_rmse_m == pytest.approx(one.rpe.trans_rmse_m, rel=1e-6)
    assert other.rpe.rot_rmse_deg == pytest.approx(one.rpe.rot_rmse_deg, rel=1e-6)


@given(st.randoms(use_true_random=False))
@settings(max_examples=10, deadline=None)
def test_errors_do_not_depend_on_the_order_of_poses(random: object) -> None:
    true = wandering(3)
    estimate = disturbed(true, 4)
    order = list(range(len(true)))
    random.shuffle(order)  # type: ignore[attr-defined]
    shuffled = Trajectory(estimate.stamps_ns[order], estimate.poses[order])
    assert evaluate(shuffled, true).ape == evaluate(estimate, true).ape
    assert evaluate(shuffled, true).rpe == evaluate(estimate, true).rpe


def test_a_gap_in_the_estimate_takes_away_pairs_and_makes_none_of_another_length() -> None:
    true = line(0.5, 150)
    kept = np.r_[0:40, 100:150]
    fast = line(0.55, 150)
    rpe = evaluate(Trajectory(fast.stamps_ns[kept], fast.poses[kept]), true).rpe
    assert rpe is not None
    # at most a tenth longer or shorter than a second
    assert rpe.trans_rmse_m == pytest.approx(0.05, rel=0.1)


def test_a_trajectory_shorter_than_a_second_has_no_relative_error() -> None:
    assert evaluate(wandering(0, 20), wandering(0, 20)).rpe is None


def test_trajectories_of_different_times_are_refused_with_their_spans() -> None:
    early = wandering(0)
    late = Trajectory(early.stamps_ns + 10**12, early.poses)
    with pytest.raises(InputError, match=r"only 0 poses .* from 1700000000\.0+ to 1700000002"):
        evaluate(early, late)


def test_without_a_reference_or_common_moments_there_is_no_evaluation() -> None:
    truth = wandering(0)
    later = Trajectory(truth.stamps_ns + 10 * SECOND, truth.poses)
    assert evaluated(truth, None) is None
    assert evaluated(truth, later) is None
    evaluation = evaluated(truth, truth)
    assert evaluation is not None
    figures = error_figures(evaluation)
    assert Rpe(**figures["rpe"]) == evaluation.rpe
    assert figures["ape"]["rmse_m"] == evaluation.ape.rmse_m
    short = evaluate(wandering(0, 20), truth)
    assert error_figures(short)["rpe"] is None


def run_evo(program: str, folder: Path, *arguments: str) -> dict[str, float]:
    """The statistics that a program of evo gives for estimate.txt against reference.txt."""
    path = shutil.which(program, path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    if path is None:
        pytest.skip(f"{program} is not installed")
    results = folder / f"{program}{len(list(folder.iterdir()))}.zip"
    common = ["tum", "reference.txt", "estimate.txt", "--t_max_diff", "0.02"]
    subprocess.run(
        [path, *common, "--save_results", str(results), *arguments],
        cwd=folder,
        # evo keeps its settings there
        env={**os.environ, "HOME": str(folder)},
        check=True,
        capture_output=True,
    )
    with zipfile.ZipFile(results) as archive:
        statistics: dict[str, float] = json.loads(archive.read("stats.json"))
    return statistics


def check_against_evo(folder: Path, estimate: Trajectory, reference: Trajectory) -> None:
    write_tum(folder / "estimate.txt", estimate)
    write_tum(folder / "reference.txt", reference)
    ours = evaluate(estimate, reference)
    ape = run_evo("evo_ape", folder, "--align")
    assert ours.ape.rmse_m == pytest.approx(ape["rmse"], rel=1e-6)
    assert ours.ape.mean_m == pytest.approx(ape["mean"], rel=1e-6)
    assert ours.ape.median_m == pytest.approx(ape["median"], rel=1e-6)
    assert ours.ape.max_m == pytest.approx(ape["max"], rel=1e-6)
    # evo knows no seconds: at 30 Hz, one is 30 frames
    delta = ("--delta", "30", "--delta_unit", "f", "--all_pairs")
    assert ours.rpe is not None
    translation = run_evo("evo_rpe", folder, *delta, "--pose_relation", "trans_part")
    assert ours.rpe.trans_rmse_m == pytest.approx(translation["rmse"], rel=1e-6)
    rotation = run_evo("evo_rpe", folder, *delta, "--pose_relation", "angle_deg")
    assert ours.rpe.rot_rmse_deg == pytest.approx(rotation["rmse"], rel=1e-6)


@pytest.mark.slow
def test_errors_of_a_random_trajectory_are_those_that_evo_gives(tmp_path: Path) -> None:
    true = wandering(5, 120)
    check_against_evo(tmp_path, disturbed(true, 6), true)


@pytest.mark.slow
def test_errors_of_a_real_trajectory_are_those_that_evo_gives(
    tmp_path: Path, shared_data: Path
) -> None:
    true = read_tum(shared_data / "icl_nuim_office_kt0" / "groundtruth.txt")
    check_against_evo(tmp_path, disturbed(true, 7), true)


def drifting(poses: Float64) -> Float64:
    return np.stack([se3.exp(i * 1e-4 * np.ones(6)) for i in range(len(poses))]) @ poses


@pytest.mark.slow
def test_errors_against_denser_real_ground_truth_are_those_that_evo_gives(
    tmp_path: Path, shared_data: Path
) -> None:
    true = read_tum(shared_data / "rgbd_dataset_freiburg1_desk" / "groundtruth.txt")
    # the truth is at 100 Hz: every third pose, stamped as by another clock
    estimate = Trajectory(true.stamps_ns[::3] + 2_000_000, drifting(true.poses[::3]))
    write_tum(tmp_path / "estimate.txt", estimate)
    write_tum(tmp_path / "reference.txt", true)
    ape = run_evo("evo_ape", tmp_path, "--align")
    assert evaluate(estimate, true).ape.rmse_m == pytest.approx(ape["rmse"], rel=1e-6)
