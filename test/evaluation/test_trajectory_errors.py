"""APE and RPE: closed forms, invariances, and the same figures as evo's programs."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.trajectory_errors import (
    evaluate,
    interpolated,
    normalised_errors,
    path_length,
)
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.trajectories.tum import read_tum, write_tum
from rgbd_glue_ros.types import (
    NANOSECONDS,
    Float64,
    Int64,
    OdometryEstimate,
    TrackingState,
    Trajectory,
)

SECOND = NANOSECONDS


def stamps(length: int, rate_hz: int = 30) -> Int64:
    # a rounded stamp misses its second by nanoseconds, as real ones do
    return 1_700_000_000 * SECOND + np.arange(length) * SECOND // rate_hz


def wandering(seed: int, length: int = 90, step: float = 0.02) -> Trajectory:
    rng = np.random.default_rng(seed)
    poses = [np.eye(4)]
    for _ in range(length - 1):
        poses.append(poses[-1] @ se3.exp(rng.normal(0, step, 6)))
    return Trajectory(stamps(length), np.stack(poses))


def disturbed(trajectory: Trajectory, seed: int, amount: float = 0.005) -> Trajectory:
    rng = np.random.default_rng(seed)
    noise = np.stack([se3.exp(rng.normal(0, amount, 6)) for _ in range(len(trajectory))])
    return Trajectory(trajectory.stamps_ns, trajectory.poses @ noise)


def line(velocity: float, length: int = 90) -> Trajectory:
    times = stamps(length)
    poses = np.tile(np.eye(4), (length, 1, 1))
    poses[:, 0, 3] = velocity * (times - times[0]) / SECOND
    return Trajectory(times, poses)


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


def test_the_length_of_a_path_is_the_sum_of_its_steps() -> None:
    assert path_length(line(0.5, 31).poses) == pytest.approx(0.5, abs=1e-8)
    assert path_length(np.empty((0, 4, 4))) == 0.0


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


def estimated(
    truth: Trajectory, covariance: Float64, keyframe_every: int, seed: int, scale: float = 1.0
) -> list[OdometryEstimate]:
    """Poses registered to keyframes with errors of a covariance that they know, times a scale."""
    rng = np.random.default_rng(seed)
    lower = np.linalg.cholesky(covariance) * np.sqrt(scale)
    estimates: list[OdometryEstimate] = []
    T, P, true, number = np.eye(4), np.eye(6) * 1e-8, truth.poses[0], -1
    for i, (stamp, pose) in enumerate(zip(truth.stamps_ns, truth.poses, strict=True)):
        estimate, P_estimate = T, P
        if i:
            error = se3.exp(lower @ rng.normal(size=6))
            estimate, P_estimate = error @ T @ se3.inverse(true) @ pose, P + covariance
        is_keyframe = i % keyframe_every == 0
        estimates.append(
            OdometryEstimate(
                int(stamp),
                TrackingState.TRACKING,
                estimate,
                se3.pose_covariance(estimate, P_estimate),
                is_keyframe=is_keyframe,
                keyframe_id=max(number, 0),
            )
        )
        if is_keyframe:
            T, P, true, number = estimate, P_estimate, pose, number + 1
    return estimates


COVARIANCE = np.diag([4.0, 1.0, 9.0, 1.0, 2.0, 3.0]) * 1e-6 + 1e-7


@pytest.mark.slow
def test_normalised_errors_of_an_honest_covariance_are_chi_squared_with_six_degrees() -> None:
    truth = wandering(0, 3000)
    nees = normalised_errors(estimated(truth, COVARIANCE, 7, seed=1), truth)
    assert len(nees) == 2999
    # the mean of N of them has the variance 12 / N
    assert nees.mean() == pytest.approx(6.0, abs=4 * np.sqrt(12 / 2999))
    assert stats.kstest(nees, stats.chi2(6).cdf).pvalue > 1e-3


@pytest.mark.parametrize("scale", [0.25, 4.0])
def test_normalised_errors_grow_as_covariances_are_too_small(scale: float) -> None:
    truth = wandering(0, 500)
    honest = normalised_errors(estimated(truth, COVARIANCE, 7, seed=1), truth)
    nees = normalised_errors(estimated(truth, COVARIANCE, 7, seed=1, scale=scale), truth)
    # an error is no longer small beside the distance to the origin: not to the last digit
    np.testing.assert_allclose(nees, scale * honest, rtol=1e-6)


def test_an_error_of_one_standard_deviation_along_an_axis_has_the_normalised_error_one() -> None:
    truth = wandering(3, 2)
    first, second = estimated(truth, COVARIANCE, 10, seed=0)
    moved = np.array([0, 0, np.sqrt(COVARIANCE[2, 2]), 0, 0, 0])
    # the first pose is the identity
    T = se3.exp(moved) @ se3.inverse(truth.poses[0]) @ truth.poses[1]
    covariance = np.eye(6) * 1e-8 + np.diag(np.diag(COVARIANCE))
    second = replace(second, T_odom_camera=T, covariance=se3.pose_covariance(T, covariance))
    np.testing.assert_allclose(normalised_errors([first, second], truth), [1.0], rtol=1e-6)


def test_frames_without_a_pose_a_keyframe_or_the_truth_have_no_normalised_error() -> None:
    truth = wandering(0, 60)
    estimates = estimated(truth, COVARIANCE, 7, seed=1)
    lost = OdometryEstimate(estimates[10].stamp_ns, TrackingState.LOST)
    estimates[10] = lost
    known = Trajectory(truth.stamps_ns[:40], truth.poses[:40])
    # the first frame has no other keyframe, one is lost, and 20 have no truth
    assert len(normalised_errors(estimates, known)) == 60 - 1 - 1 - 20


def test_interpolated_poses_of_a_steady_screw_are_exact_in_rotation_and_on_the_way() -> None:
    step = np.array([0.02, 0, 0, 0, 0, 0.05])
    poses = np.stack([se3.exp(i * step) for i in range(11)])
    truth = Trajectory(stamps(11), poses)
    between = (truth.stamps_ns[:-1] + truth.stamps_ns[1:]) // 2
    found = interpolated(truth, between)
    exact = np.stack([se3.exp((i + 0.5) * step) for i in range(10)])
    np.testing.assert_allclose(found[:, :3, :3], exact[:, :3, :3], atol=1e-7)
    # a chord of the arc, whose sagitta is that of an angle of 0.05 over 2 cm
    assert np.abs(found[:, :3, 3] - exact[:, :3, 3]).max() < 0.02 * 0.05 / 8 * 1.01


def test_at_its_own_stamps_an_interpolated_trajectory_is_itself() -> None:
    truth = wandering(5)
    order = np.random.default_rng(0).permutation(len(truth))
    shuffled = Trajectory(truth.stamps_ns[order], truth.poses[order])
    np.testing.assert_allclose(interpolated(shuffled, truth.stamps_ns), truth.poses, atol=1e-12)


def test_nothing_is_known_outside_the_truth_nor_in_its_gaps() -> None:
    truth = wandering(0, 60)
    kept = np.r_[0:20, 40:60]
    with_gap = Trajectory(truth.stamps_ns[kept], truth.poses[kept])
    wanted = np.r_[truth.stamps_ns[0] - 1, truth.stamps_ns[30], truth.stamps_ns[-1] + 1]
    assert np.isnan(interpolated(with_gap, wanted)).all()
    assert np.isnan(interpolated(Trajectory(truth.stamps_ns[:1], truth.poses[:1]), wanted)).all()


def test_a_truth_of_few_poses_is_known_at_their_very_stamps() -> None:
    truth = wandering(0, 60)
    rare = Trajectory(truth.stamps_ns[::20], truth.poses[::20])
    wanted = np.r_[truth.stamps_ns[20], truth.stamps_ns[21]]
    found = interpolated(rare, wanted)
    np.testing.assert_array_equal(found[0], truth.poses[20])
    assert np.isnan(found[1]).all()
