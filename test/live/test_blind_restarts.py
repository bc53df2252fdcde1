"""What is said of a pose after the odometry has restarted where it was, not where the camera is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.live.blind_restarts import BlindRestarts
from rgbd_glue_ros.live.monitor import Monitor
from rgbd_glue_ros.types import (
    NANOSECONDS,
    Correspondences,
    OdometryEstimate,
    RegistrationResult,
    RegistrationStatus,
    TrackingState,
)

NONE = Correspondences.empty()
REGISTERED = RegistrationResult(np.eye(4), RegistrationStatus.OK, NONE, NONE, NONE, NONE)


def posed(seconds: float, sigma_m: float, *, is_start: bool = False) -> OdometryEstimate:
    return OdometryEstimate(
        round(seconds * NANOSECONDS),
        TrackingState.TRACKING,
        np.eye(4),
        np.diag([sigma_m] * 3 + [sigma_m / 2] * 3) ** 2,
        is_keyframe=is_start,
        registration=None if is_start else REGISTERED,
    )


def after(*estimates: OdometryEstimate) -> BlindRestarts:
    restarts = BlindRestarts()
    for estimate in estimates:
        restarts.take(estimate)
    return restarts


START = posed(0, 1e-3, is_start=True)
LOST = OdometryEstimate(NANOSECONDS, TrackingState.LOST)


def test_a_restart_is_doubted_until_the_pose_is_known_again() -> None:
    restarted = [START, posed(1, 0.01), LOST, posed(9, 8.0, is_start=True)]
    said = "not recognised at 9.000: restarted at the last pose, which may be 8.0 m and 4.0 rad off"
    assert after(*restarted).doubt == said
    assert after(*restarted, posed(10, 8.3)).doubt == said
    assert after(*restarted, LOST).doubt == said
    recognised = after(*restarted, posed(10, 8.3), posed(11, 0.02))
    assert (recognised.count, recognised.doubt) == (1, "")


def test_a_start_and_a_camera_that_is_found_again_are_no_restarts() -> None:
    found = after(START, posed(1, 0.01), LOST, posed(2, 0.01))
    assert (found.count, found.doubt) == (0, "")


def test_of_several_restarts_the_last_is_said_and_all_are_counted() -> None:
    twice = after(START, posed(5, 3.0, is_start=True), posed(6, 3.0), posed(20, 9.5, is_start=True))
    assert twice.count == 2
    assert twice.doubt.startswith("not recognised at 20.000")


def test_diagnostics_have_the_count_and_how_certain_the_pose_is() -> None:
    monitor = Monitor()
    before = monitor.values(0)
    assert (before["blind_restarts"], before["position_sigma_m"]) == ("0", "nan")
    for estimate in (START, LOST, posed(9, 8.0, is_start=True), LOST):
        monitor.processed(estimate, 0, 0)
    told = monitor.values(0)
    assert (told["blind_restarts"], told["position_sigma_m"]) == ("1", "8.00000")
    assert told["rotation_sigma_rad"] == "4.00000"
    monitor.start_anew()
    monitor.processed(replace(START, stamp_ns=20 * NANOSECONDS), 0, 0)
    assert (monitor.values(0)["blind_restarts"], monitor.restarts.doubt) == ("0", "")
