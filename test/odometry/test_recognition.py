"""Back at a known place the camera knows where it is, and before that how little it knows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from rigs import bare_wall
from rigs.bag_frames import errors, recorded_frames, true_poses

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.types import (
    NANOSECONDS,
    EdgeOrigin,
    Float64,
    OdometryEstimate,
    RgbdFrame,
    TrackingState,
)

# the camera's position along the wall, metres, at seconds
WAYS = {
    "there and back": ([0.0, 2.5, 5.0], [0.0, 1.5, 0.0]),
    "there, waiting, and back": ([0.0, 2.5, 4.5, 6.0], [0.0, 1.5, 1.5, 0.6]),
    "far along the wall and back": ([0.0, 4.0, 8.0], [0.0, 2.4, 0.0]),
}


def positions(seconds: list[float], metres: list[float]) -> Float64:
    """The position of the camera in each frame, metres."""
    times = np.arange(0, seconds[-1], 1 / bare_wall.HZ)
    return np.asarray(np.interp(times, seconds, metres), np.float64)


def tracked(x: Float64, seed: int) -> list[OdometryEstimate]:
    with Odometry(Config()) as odometry:
        return [odometry.process(frame) for frame in bare_wall.frames(x, seed)]


@cache
def tracked_on_way(way: str, seed: int) -> list[OdometryEstimate]:
    return tracked(positions(*WAYS[way]), seed)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "way"), list(enumerate(WAYS)))
def test_back_from_a_bare_wall_a_camera_recognises_where_it_was_and_has_not_claimed_to_know_it(
    way: str, seed: int
) -> None:
    x = positions(*WAYS[way])
    estimates = tracked_on_way(way, seed)
    poses = np.array([e.T_odom_camera for e in estimates if e.T_odom_camera is not None])
    covariances = [e.covariance for e in estimates if e.covariance is not None]
    off, stated = poses[:, 0, 3] - x, np.sqrt([covariance[0, 0] for covariance in covariances])
    assert (np.abs(off) < 5 * stated + 0.02).all()
    at_the_wall = np.flatnonzero(x > bare_wall.POSTER_M + 0.1)
    assert stated[at_the_wall[-1]] > 0.25
    # the error is known: it remains as drift, by which the pose does not jump
    np.testing.assert_allclose(stated[-1], abs(off[-1]), atol=0.02)
    from_keyframe = estimates[-1].covariance_from_keyframe
    assert from_keyframe is not None
    assert np.sqrt(from_keyframe[0, 0]) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "way"), list(enumerate(WAYS)))
def test_edges_measured_at_a_bare_wall_state_by_how_much_they_are_wrong(
    way: str, seed: int
) -> None:
    x = positions(*WAYS[way])
    estimates = tracked_on_way(way, seed)
    of_keyframes = x[[e.is_keyframe for e in estimates]]
    edges = [edge for e in estimates for edge in e.edges]
    assert {edge.child for edge in edges} == set(range(1, len(of_keyframes)))
    for edge in edges:
        T = se3.exp(np.array([of_keyframes[edge.child] - of_keyframes[edge.parent], *[0.0] * 5]))
        error = se3.log(edge.T_parent_child @ se3.inverse(T))
        # six degrees of freedom: one of a million is beyond
        assert error @ np.linalg.solve(edge.covariance, error) < 38


@pytest.mark.slow
def test_a_camera_that_stops_at_a_bare_wall_is_not_said_to_move_on() -> None:
    x = positions([0.0, 2.5, 10.5], [0.0, 1.5, 1.5])
    poses = [e.T_odom_camera for e in tracked(x, seed=2) if e.T_odom_camera is not None]
    assert abs(poses[-1][0, 3] - x[-1]) < 0.3
    # nor to turn, or to tremble
    two_seconds = 2 * bare_wall.HZ
    since = np.array(poses)[np.flatnonzero(x == 1.5)[0] + two_seconds :]
    off = [se3.difference(pose, since[0]) for pose in since]
    assert max(off) < 0.05


@pytest.mark.slow
def test_when_all_texture_is_replaced_motion_is_measured_by_the_new_one() -> None:
    """As when another poster is put up: of a bare wall behind it, planes agree with any pose."""
    x = positions([0.0, 2.0, 4.0], [0.0, 0.0, 0.6])
    new = bare_wall.frames(x, seed=2, poster_m=3.0)
    old = bare_wall.frames(x, seed=1, poster_m=3.0)
    frames = [
        before if i < 10 else after for i, (before, after) in enumerate(zip(old, new, strict=True))
    ]
    with Odometry(Config()) as odometry:
        estimates = [odometry.process(frame) for frame in frames]
    poses = [e.T_odom_camera for e in estimates if e.T_odom_camera is not None]
    way = poses[-1][0, 3] - poses[20][0, 3]
    np.testing.assert_allclose(way, x[-1] - x[20], atol=0.03)


@pytest.mark.slow
def test_after_a_restart_somewhere_else_a_camera_that_returns_recognises_where_it_was_before() -> (
    None
):
    estimates, x = covered_and_carried_off()
    restarted = next(i for i, e in enumerate(estimates) if e.is_start and i > 0)
    made_at = [x[i] for i, estimate in enumerate(estimates) if estimate.is_keyframe]
    edges = [edge for estimate in estimates for edge in estimate.edges]
    # by an edge from a keyframe before the restart to one after it, ...
    (assumed,) = (edge for edge in edges if edge.origin is EdgeOrigin.ASSUMED)
    loops = [e for e in edges if e.parent < assumed.child <= e.child and e is not assumed]
    assert loops
    for edge in loops:
        way = made_at[edge.child] - made_at[edge.parent]
        np.testing.assert_allclose(edge.T_parent_child[0, 3], way, atol=0.02)
    # ... and as drift, that the pose does not jump by
    last = estimates[-1]
    assert last.T_odom_camera is not None
    assert last.covariance is not None
    off = last.T_odom_camera[0, 3] - x[-1]
    np.testing.assert_allclose(np.sqrt(last.covariance[0, 0]), abs(off), atol=0.02)
    poses = [e.T_odom_camera for e in estimates[restarted:] if e.T_odom_camera is not None]
    assert np.abs(np.diff(poses, axis=0)).max() < 0.05


def covered_and_carried_off() -> tuple[list[OdometryEstimate], Float64]:
    """A camera that is covered, carried off, and then moves back; with its positions, metres."""
    away_m = 0.2 + bare_wall.VIEW_M
    x = np.concatenate(
        [
            positions([0.0, 1.0, 2.5], [0.0, 0.2, 0.2]),
            positions([0.0, 1.0, 5.0], [away_m, away_m, 0.0]),
        ]
    )
    with Odometry(Config()) as odometry:
        estimates = []
        for frame in bare_wall.frames(x, seed=1, poster_m=3.0):
            is_covered = 1.0 < frame.stamp_ns / NANOSECONDS < 2.5
            seen = without_sight(frame) if is_covered else frame
            estimates.append(odometry.process(seen))
    return estimates, x


def without_sight(frame: RgbdFrame) -> RgbdFrame:
    """A frame of a covered camera."""
    return replace(frame, color=np.zeros_like(frame.color), depth=np.full_like(frame.depth, np.nan))


def before_hand(frame: RgbdFrame, seed: int) -> RgbdFrame:
    """A hand that covers the view a fifth of a metre away, near enough to be measured in part."""
    rng = np.random.default_rng(seed)
    shape = frame.depth.shape
    skin = np.array([180, 120, 90]) + rng.normal(0, 3, (*shape, 3))
    depth = 0.18 + rng.normal(0, 0.002, shape)
    depth[rng.random(shape) < 0.3] = np.nan
    return replace(frame, color=skin.astype(np.uint8), depth=depth.astype(np.float32))


@pytest.mark.slow
def test_when_a_hand_leaves_the_view_the_way_since_it_came_is_not_taken_for_a_velocity() -> None:
    """Tracking starts anew at the hand, where the camera was; then it finds itself elsewhere."""
    frames = recorded_frames()
    seen = [before_hand(f, i) if 40 <= i < 75 else f for i, f in enumerate(frames)]
    with Odometry(Config()) as odometry:
        estimates = [odometry.process(frame) for frame in seen]
    assert any(e.is_start for e in estimates[40:75])
    off, _ = errors(estimates, true_poses())
    found = next(
        i
        for i in range(75, len(frames))
        if estimates[i].state is TrackingState.TRACKING and not estimates[i].is_start
    )
    assert found < 80
    assert off[found:].max() < 0.003
    for i in range(found, len(frames)):
        twist = estimates[i].twist
        assert twist is not None
        assert np.linalg.norm(twist[:3]) < 1.0
        assert np.linalg.norm(twist[3:]) < 1.0
