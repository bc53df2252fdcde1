"""Where a part of the view moves otherwise than the rest, the covariance covers both motions."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from rigs.bag_frames import errors, recorded_frames, true_poses
from rigs.pose_problems import problem_at_rest
from rigs.room import room_view, true_pose
from rigs.scenes import SCENES

from rgbd_glue_ros.experiments.bench.passer_by import PasserBy
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.alternative import Alternative, find_alternative, is_contradicted
from rgbd_glue_ros.odometry.candidates import refined_candidate
from rgbd_glue_ros.odometry.contradiction import contradiction_covariance, settle_contradiction
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.odometry.pose_refinement import COARSE_LEVELS, PoseProblem
from rgbd_glue_ros.odometry.progress import LastPose
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.gauss_newton import evaluate_pose
from rgbd_glue_ros.types import Float64, OdometryEstimate, RgbdFrame, TrackingState, View

CONFIG = Config()
ACCEPTANCE = Acceptance.of(CONFIG.odometry)
IN_FRONT = PasserBy(distance=1.6, reach=0.4, period=6.0, tall=0.7)
"""Is half of the view from the first frame on, and walks slowly."""
CLOSE_BY = PasserBy(distance=1.0, radius=0.3, reach=1.2, period=5.0, tall=9.0)
"""Covers most of the view for a while."""
UNSEEN_M = 0.025
"""What a surface 3 m away may be off by before its depth shows it."""


def crossed(somebody: PasserBy, step: int, count: int) -> list[RgbdFrame]:
    frames = recorded_frames()
    return [somebody.before(f, frames[0].stamp_ns) for f in frames[: step * count : step]]


def doubts(estimates: list[OdometryEstimate], off: Float64) -> Float64:
    """The standard deviation of each estimate in the direction that it is off, metres."""
    directions = off / np.maximum(np.linalg.norm(off, axis=1), 1e-9)[:, np.newaxis]
    covariances = np.array([e.covariance[:3, :3] for e in estimates if e.covariance is not None])
    squared: Float64 = np.einsum("ni,nij,nj->n", directions, covariances, directions)
    return np.sqrt(squared)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("somebody", "step", "count"),
    [(IN_FRONT, 1, 40), (CLOSE_BY, 1, 60), (CLOSE_BY, 5, 21), (PasserBy(period=3.5), 5, 21)],
)
def test_a_passer_by_shifts_the_pose_by_less_than_three_stated_sigmas(
    somebody: PasserBy, step: int, count: int
) -> None:
    truth = true_poses()[: step * count : step]
    with Odometry(CONFIG) as odometry:
        estimates = [odometry.process(frame) for frame in crossed(somebody, step, count)]
    poses = np.array([e.T_odom_camera for e in estimates])
    off = (poses - truth)[:, :3, 3]
    said = doubts(estimates, off)
    assert (np.linalg.norm(off, axis=1) < 3 * said + UNSEEN_M).all()
    metres, _ = errors(estimates, truth)
    assert metres.max() < 0.12
    # no step of odom beyond the camera's own is longer than what is said of its two ends
    steps = np.linalg.norm(np.diff(off, axis=0), axis=1)
    assert (steps < 3 * np.hypot(said[:-1], said[1:]) + UNSEEN_M).all()


def prepared(frame: RgbdFrame) -> View:
    return view_of(frame, CONFIG.camera)


def alternative(of: PoseProblem, T: Float64) -> Alternative | None:
    pose = evaluate_pose(T, of, COARSE_LEVELS[-1])
    return find_alternative(of, pose, None, ACCEPTANCE)


def test_the_room_behind_a_person_is_found_and_is_the_larger_part() -> None:
    frames = crossed(IN_FRONT, 1, 5)
    of = problem_at_rest(prepared(frames[0]), prepared(frames[4]))
    truth = true_poses()[4]
    carried_along = of.refined(np.eye(4), COARSE_LEVELS).T_model_source
    assert np.linalg.norm((carried_along - truth)[:3, 3]) > 0.05
    found = alternative(of, carried_along)
    assert found is not None
    assert np.linalg.norm((found.T_track_camera - truth)[:3, 3]) < 0.01
    assert found.is_larger


def test_of_a_pose_that_takes_the_place_of_another_all_planes_are_counted() -> None:
    frames = crossed(IN_FRONT, 1, 5)
    of = problem_at_rest(prepared(frames[0]), prepared(frames[4]))
    carried_along = refined_candidate(np.eye(4), of, ACCEPTANCE)
    at_rest = Motion.start(0, np.eye(4))
    estimate = OdometryEstimate(0, TrackingState.TRACKING, np.eye(4))
    last = LastPose(at_rest, prepared(frames[3]), estimate, Alternative(true_poses()[3], 0.6))
    settled = settle_contradiction(carried_along, of, last, ACCEPTANCE).estimate
    T = settled.T_track_camera
    assert np.linalg.norm((T - true_poses()[4])[:3, 3]) < 0.01
    by_all = evaluate_pose(T, of.with_twist_used_for(settled))
    assert settled.refinement.planes_seen == by_all.planes_seen
    assert settled.refinement.planes_agreeing == by_all.planes_agreeing
    assert settled.refinement.planes_occluded == by_all.planes_occluded


def test_a_person_in_view_contradicts_the_pose_and_noise_does_not() -> None:
    frames = crossed(IN_FRONT, 1, 5)
    of = problem_at_rest(prepared(frames[0]), prepared(frames[4]))
    assert is_contradicted(evaluate_pose(true_poses()[4], of))
    of = problem_at_rest(prepared(recorded_frames()[0]), prepared(recorded_frames()[4]))
    assert not is_contradicted(evaluate_pose(true_poses()[4], of))


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("place", ["a blank wall with one poster", "a bare corridor at 10 Hz"])
def test_the_noise_of_stereo_depth_is_no_part_of_the_view_that_moves(place: str, seed: int) -> None:
    scene = SCENES[place]
    frames = [*islice(scene.noisy_frames(seed, is_stereo=True), 6)]
    # as if nobody had noticed how noisy it is
    before, now = (replace(prepared(frame), depth_noise=1.0) for frame in (frames[0], frames[5]))
    of = problem_at_rest(before, now)
    truth = scene.true_poses()[5]
    assert is_contradicted(evaluate_pose(truth, of))
    assert alternative(of, truth) is None


def test_a_view_that_agrees_with_its_pose_has_no_alternative() -> None:
    of = problem_at_rest(room_view(0.0), room_view(0.3))
    truth = se3.inverse(true_pose(0.0)) @ true_pose(0.3)
    assert alternative(of, truth) is None
    pose = evaluate_pose(truth, of)
    np.testing.assert_array_equal(
        contradiction_covariance(pose, None, np.eye(6), ACCEPTANCE), np.zeros((6, 6))
    )


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_a_contradiction_adds_the_second_moment_of_the_two_poses(share: float) -> None:
    of = problem_at_rest(room_view(0.0), room_view(0.3))
    truth = se3.inverse(true_pose(0.0)) @ true_pose(0.3)
    pose = evaluate_pose(truth, of)
    apart = np.array([0.2, 0.0, -0.1, 0.0, 0.03, 0.0])
    other = Alternative(se3.exp(apart) @ truth, share)
    added = contradiction_covariance(pose, other, np.eye(6), ACCEPTANCE)
    draws = np.random.default_rng(0).random(200_000) < share
    sampled = np.where(draws[:, np.newaxis], apart, 0.0)
    np.testing.assert_allclose(added, sampled.T @ sampled / len(draws), atol=5e-4)


def test_a_pose_that_most_planes_contradict_gets_the_covariance_of_its_reach() -> None:
    of = problem_at_rest(room_view(0.0), room_view(0.0))
    wrong = evaluate_pose(se3.exp(np.array([0, 0, 0.5, 0, 0, 0])), of)
    assert wrong.planes_agreeing < wrong.planes_visible / 2
    reach = np.diag([1.0] * 3 + [0.1] * 3)
    added = contradiction_covariance(wrong, None, reach, ACCEPTANCE)
    assert np.linalg.eigvalsh(added).min() > 0
    assert added[2, 2] > 0.5
