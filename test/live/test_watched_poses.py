"""Rate, latency and path of poses that another program receives."""

from __future__ import annotations

import numpy as np
import pytest

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.watched_poses import STEP_M, ReceivedPose, WatchedPoses
from rgbd_glue_ros.types import NANOSECONDS

MS = 1_000_000
PERIOD_NS = 40 * MS


def pose(
    index: int, x: float = 0.0, yaw: float = 0.0, latency_ns: int = 50 * MS, y: float = 0.0
) -> ReceivedPose:
    """The pose of a frame at 25 Hz."""
    stamp_ns = NANOSECONDS + index * PERIOD_NS
    T = se3.exp(np.array([0, 0, 0, 0, 0, yaw]))
    T[:2, 3] = x, y
    return ReceivedPose(stamp_ns, T, stamp_ns + 7, latency_ns)


def watched(*poses: ReceivedPose) -> WatchedPoses:
    them = WatchedPoses()
    for each in poses:
        them.add(each)
    return them


def test_before_the_first_pose_nothing_is_known() -> None:
    them = watched()
    assert (them.last, them.path_m, them.turn_rad) == (None, 0.0, 0.0)
    assert them.rate_hz(0) is None
    assert them.latency_ms(0) is None


def test_the_rate_is_that_of_the_last_two_seconds() -> None:
    them = watched(*(pose(i) for i in range(100)))
    now_ns = pose(99).arrived_ns
    assert them.rate_hz(now_ns) == pytest.approx(25.0)
    assert them.rate_hz(now_ns + 3 * NANOSECONDS) is None


def test_the_latency_is_the_median_and_none_if_the_stamps_are_of_another_clock() -> None:
    late = watched(pose(0), pose(1, latency_ns=900 * MS), pose(2, latency_ns=60 * MS))
    assert late.latency_ms(pose(2).arrived_ns) == pytest.approx(60.0)
    ahead = watched(pose(0, latency_ns=-20 * MS))
    assert ahead.latency_ms(pose(0).arrived_ns) == pytest.approx(-20.0)
    for years_ns in (10**17, -(10**17)):
        assert watched(pose(0, latency_ns=years_ns)).latency_ms(pose(0).arrived_ns) is None


def test_the_path_is_what_was_travelled_and_the_turn_that_since_the_first_pose() -> None:
    there = [pose(i, 0.02 * i, np.radians(i)) for i in range(51)]
    back = [pose(51 + i, 1.0 - 0.02 * i, np.radians(50 - i)) for i in range(31)]
    them = watched(*there, *back)
    assert them.path_m == pytest.approx(1.6)
    assert them.turn_rad == pytest.approx(np.radians(20))


def test_a_camera_at_rest_travels_nowhere_however_its_poses_tremble() -> None:
    tremble = np.random.default_rng(0).normal(0, STEP_M / 10, (1000, 2))
    assert watched(*(pose(i, x, y=y) for i, (x, y) in enumerate(tremble))).path_m == 0.0


def test_a_jump_that_no_camera_makes_is_a_reset_and_no_path() -> None:
    there = [pose(i, 0.02 * i) for i in range(251)]
    anew = [pose(251 + i, 0.02 * i) for i in range(51)]
    assert watched(*there, *anew).path_m == pytest.approx(6.0)
