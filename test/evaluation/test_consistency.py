"""Normalised errors are those of the covariances that the estimates were drawn from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.trajectories import wandering
from scipy import stats

from rgbd_glue_ros.evaluation.consistency import normalised_errors
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import Float64, OdometryEstimate, TrackingState, Trajectory


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
