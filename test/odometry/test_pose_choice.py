"""Of two poses of a frame, the one is chosen that what tells them apart speaks for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.pose_problems import problem_at_rest
from rigs.room import room_view, true_pose
from rigs.unseen import without_depth

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.pose_choice import Candidate, choose, is_clear
from rgbd_glue_ros.odometry.pose_refinement import PoseEstimate, PoseProblem
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.gauss_newton import evaluate_pose
from rgbd_glue_ros.refinement.problem import NO_MATCHES
from rgbd_glue_ros.types import CameraIntrinsics, Correspondences, Float64, View

CONFIG = Config()
CAMERA = CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
T_IN = CONFIG.glue.inlier_threshold


def along(metres: float) -> Float64:
    """A pose so far along the wall."""
    return se3.exp(np.array([metres, 0.0, 0.0, 0.0, 0.0, 0.0]))


def blank_wall() -> View:
    """Shows one plane and no texture: where along it the camera is, it does not say."""
    return View(np.full((240, 320), 200, np.uint8), np.full((240, 320), 2.0, np.float32), CAMERA)


def moved_matches(metres: float, count: int) -> Correspondences:
    """Matches of a camera that went so far along the wall."""
    points = np.random.default_rng(0).uniform([-0.8, -0.6, 2.0], [0.8, 0.6, 2.0], (count, 3))
    return Correspondences(points, points + np.array([metres, 0.0, 0.0]), np.ones(count))


def candidate(T: Float64, of: PoseProblem, distance_squared: float = 6.0) -> Candidate:
    refinement = evaluate_pose(T, of)
    return Candidate(PoseEstimate(refinement), refinement, distance_squared, 0.0)


def clear(found: Candidate, matches: Correspondences = NO_MATCHES) -> bool:
    return is_clear(found, matches, T_IN, Acceptance.of(CONFIG.odometry))


def chosen(candidates: list[Candidate], of: PoseProblem) -> Candidate | None:
    return choose(candidates, of.matches, T_IN, Acceptance.of(CONFIG.odometry))


def test_along_a_blank_wall_the_matches_decide() -> None:
    along_wall = problem_at_rest(blank_wall(), blank_wall(), moved_matches(0.1, 30))
    walked, stuck = candidate(along(0.1), along_wall), candidate(along(0.0), along_wall)
    assert chosen([stuck, walked], along_wall) is walked
    assert chosen([walked, stuck], along_wall) is walked


def test_matches_and_the_finest_level_outvote_coarse_levels_and_motion() -> None:
    along_wall = problem_at_rest(blank_wall(), blank_wall(), moved_matches(0.1, 30))
    # as if a lamp on the camera lit the wall: its light correlates where the camera was
    walked, stuck = candidate(along(0.1), along_wall, 40.0), candidate(along(0.0), along_wall, 1.0)
    lit = replace(stuck.coarse, brightness_correlation=0.9)
    unlit = replace(stuck.refinement, brightness_correlation=0.0)
    sharp = replace(walked.refinement, brightness_correlation=0.8, pixels_seen=1000)
    wrong = replace(stuck, coarse=lit, estimate=PoseEstimate(unlit))
    right = replace(walked, estimate=PoseEstimate(sharp))
    assert chosen([wrong, right], along_wall) is right
    assert chosen([right, wrong], along_wall) is right


def with_figures(found: Candidate, finest: tuple[float, float], coarse: float) -> Candidate:
    """A candidate as if so large a part of its planes agreed, and brightness correlated so well."""
    agreement, correlation = finest
    agreeing = round(agreement * found.refinement.planes_seen)
    refinement = replace(
        found.refinement,
        planes_agreeing=agreeing,
        pixels_seen=1000,
        brightness_correlation=correlation,
    )
    lit = replace(found.coarse, brightness_correlation=coarse)
    return replace(found, estimate=PoseEstimate(refinement), coarse=lit)


@pytest.mark.parametrize(
    ("agreement", "distance_squared", "follows_matches"),
    [(0.9, 6.0, True), (0.4, 6.0, False), (0.9, 21.0, False)],
)
def test_matches_decide_where_the_finest_level_planes_and_motion_are_not_against_them(
    agreement: float, distance_squared: float, follows_matches: bool
) -> None:
    along_wall = problem_at_rest(blank_wall(), blank_wall(), moved_matches(0.1, 30))
    walked = candidate(along(0.1), along_wall, distance_squared)
    stuck = candidate(along(0.0), along_wall, 6.0 if distance_squared == 6.0 else 0.1)
    with_matches = with_figures(walked, (agreement, 0.9), coarse=0.3)
    without = with_figures(stuck, (agreement - 0.05, 0.9), coarse=0.9)
    found = chosen([without, with_matches], along_wall)
    assert found is (with_matches if follows_matches else without)
    assert found is chosen([with_matches, without], along_wall)


@pytest.mark.parametrize(("agreement", "follows_matches"), [(0.85, True), (0.75, False)])
def test_matches_do_not_decide_against_a_finest_level_that_is_clearly_against_them(
    agreement: float, follows_matches: bool
) -> None:
    # as with a passer-by who has the texture, in front of walls that have the surface
    along_wall = problem_at_rest(blank_wall(), blank_wall(), moved_matches(0.1, 30))
    walked, stuck = candidate(along(0.1), along_wall), candidate(along(0.0), along_wall)
    with_matches = with_figures(walked, (agreement, 0.9), coarse=0.8)
    without = with_figures(stuck, (0.9, 0.9), coarse=0.75)
    less = replace(
        with_matches.coarse, planes_agreeing=round(0.9 * with_matches.coarse.planes_agreeing)
    )
    with_matches = replace(with_matches, coarse=less)
    assert chosen([without, with_matches], along_wall) is (
        with_matches if follows_matches else without
    )


def test_if_nothing_else_differs_the_expected_pose_is_chosen() -> None:
    along_wall = problem_at_rest(blank_wall(), blank_wall())
    far, near = candidate(along(0.3), along_wall, 20.0), candidate(along(0.0), along_wall, 1.0)
    assert chosen([far, near], along_wall) is near


def test_in_a_repetitive_scene_equally_many_matches_do_not_make_the_pose_jump() -> None:
    twins = moved_matches(0.3, 60) + moved_matches(0.0, 30)
    along_wall = problem_at_rest(blank_wall(), blank_wall(), twins)
    jump, walk = candidate(along(0.3), along_wall, 22.0), candidate(along(0.0), along_wall, 0.1)
    assert chosen([walk, jump], along_wall) is walk


def test_matches_on_a_person_who_walks_by_do_not_outvote_the_walls() -> None:
    room = problem_at_rest(room_view(0.0), room_view(0.3), moved_matches(0.5, 200))
    truth = se3.inverse(true_pose(0.0)) @ true_pose(0.3)
    right, carried_along = candidate(truth, room), candidate(along(0.5) @ truth, room)
    assert chosen([carried_along, right], room) is right


@pytest.mark.parametrize("metres", [0.02, 0.05, 0.2])
def test_planes_and_pixels_select_the_true_pose_without_matches(metres: float) -> None:
    room = problem_at_rest(room_view(0.0), room_view(0.3))
    truth = se3.inverse(true_pose(0.0)) @ true_pose(0.3)
    right, off = candidate(truth, room), candidate(along(metres) @ truth, room)
    assert chosen([off, right], room) is right


def test_a_rejected_pose_does_not_compete() -> None:
    along_wall = problem_at_rest(blank_wall(), blank_wall(), moved_matches(0.5, 100))
    out_of_reach = candidate(along(0.5), along_wall, 1000.0)
    here = candidate(along(0.0), along_wall)
    assert chosen([out_of_reach, here], along_wall) is here
    assert chosen([out_of_reach], along_wall) is None


def test_if_planes_and_matches_do_not_determine_a_pose_another_one_is_searched_for() -> None:
    room = room_view(0.0)
    right, wrong = np.eye(4), se3.exp(np.array([0.0, 0.0, 0.0, 0.0, 0.3, 0.0]))
    in_room = problem_at_rest(room, room)
    assert clear(candidate(right, in_room))
    assert not clear(candidate(wrong, in_room))
    few, enough = moved_matches(0.0, 19), moved_matches(0.0, 20)
    assert not clear(candidate(wrong, in_room), enough)
    no_planes = problem_at_rest(blank_wall(), without_depth(blank_wall()))
    assert not clear(candidate(right, no_planes), few)
    assert clear(candidate(right, no_planes), enough)


def test_a_few_planes_make_no_pose_clear_even_if_all_of_them_agree() -> None:
    room = room_view(0.0)
    in_room = problem_at_rest(room, room)
    planes = in_room.model.planes
    few = slice(CONFIG.odometry.min_planes // 2 - 1)
    of_few = replace(in_room, model=replace(in_room.model, planes=planes.selected(few)))
    found = candidate(np.eye(4), of_few)
    assert found.coarse.visible_agreement > 0.9
    assert not clear(found)
