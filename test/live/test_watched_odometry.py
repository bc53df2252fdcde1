"""The line about an odometry: state, pose, and what is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.frame_counts import Drop
from rgbd_glue_ros.live.monitor import Monitor
from rgbd_glue_ros.live.watched_odometry import Report, WatchedOdometry
from rgbd_glue_ros.live.watched_poses import ReceivedPose
from rgbd_glue_ros.types import NANOSECONDS, OdometryEstimate, TrackingState

MS = 1_000_000
SILENT = "nobody publishes /odom"


def report(state: TrackingState, message: str, arrived_ns: int, latency_ms: int = 17) -> Report:
    monitor = Monitor(lambda: 0)
    monitor.processed(OdometryEstimate(0, state, None), 0, latency_ms * MS)
    read = Report.parse(message, monitor.values(0), arrived_ns)
    assert read is not None
    return read


def pose(at_ns: int, latency_ns: int = 45 * MS) -> ReceivedPose:
    T = se3.exp(np.array([0, 0, 0, 0, 0, np.radians(at_ns / NANOSECONDS)]))
    T[:3, 3] = at_ns / NANOSECONDS, -0.25, 0.0625
    return ReceivedPose(at_ns, T, at_ns, latency_ns)


def watched(until_s: float = 3.0, latency_ns: int = 45 * MS) -> WatchedOdometry:
    """An odometry at 20 Hz."""
    odometry = WatchedOdometry()
    for at_ns in range(0, round(until_s * NANOSECONDS) + 1, 50 * MS):
        odometry.take_pose(pose(at_ns, latency_ns))
    return odometry


def test_before_anything_has_arrived_there_is_no_pose_yet() -> None:
    odometry = WatchedOdometry()
    assert (odometry.line(0), odometry.reason(0)) == ("no pose yet", "")
    odometry.silence = SILENT
    assert odometry.reason(0) == SILENT


def test_while_poses_arrive_the_line_has_rate_latency_and_pose() -> None:
    assert watched().line(3 * NANOSECONDS) == (
        "tracking, 20.0 Hz, latency 45 ms, x 3.000 y -0.250 z 0.062 m, path 3.0 m, turn 3°"
    )


def test_what_is_almost_zero_has_no_sign() -> None:
    odometry = WatchedOdometry()
    T = np.eye(4)
    T[:3, 3] = -1e-5
    odometry.take_pose(replace(pose(0), T_odom_child=T))
    assert "x 0.000 y 0.000 z 0.000 m" in odometry.line(0)


def test_where_stamps_are_of_another_clock_the_nodes_own_latency_is_shown() -> None:
    odometry = watched(latency_ns=10**18)
    assert "latency" not in odometry.line(3 * NANOSECONDS)
    odometry.take_report(report(TrackingState.TRACKING, "tracking", 3 * NANOSECONDS))
    assert "20.0 Hz, node latency 17 ms, x" in odometry.line(3 * NANOSECONDS)
    assert odometry.reason(3 * NANOSECONDS) == ""


def test_a_lost_camera_is_lost_at_once_with_the_reason_until_the_next_pose() -> None:
    odometry = watched()
    lost_ns = 3 * NANOSECONDS + 100 * MS
    odometry.take_report(report(TrackingState.LOST, "lost: it is dark", lost_ns))
    now_ns = lost_ns + 900 * MS
    assert odometry.line(now_ns).startswith("lost for 1 s, last at x 3.000 y -0.250 z 0.062 m, pa")
    assert odometry.reason(now_ns) == "it is dark"
    odometry.take_pose(pose(now_ns))
    assert odometry.line(now_ns).startswith("tracking, ")


def test_the_reason_of_a_node_that_is_silent_is_forgotten_and_silence_is_explained() -> None:
    odometry = watched()
    odometry.take_report(report(TrackingState.LOST, "lost: it is dark", 3 * NANOSECONDS))
    odometry.silence = SILENT
    now_ns = 13 * NANOSECONDS
    assert odometry.line(now_ns).startswith("no pose for 10 s, last at x 3.000 ")
    assert odometry.reason(now_ns) == SILENT
    odometry.take_pose(pose(now_ns))
    assert odometry.reason(now_ns) == ""


def test_what_is_wrong_with_poses_that_arrive_is_shown_too() -> None:
    odometry = watched()
    now_ns = 3 * NANOSECONDS
    odometry.doubt = "/odom has 2 publishers"
    assert odometry.reason(now_ns) == "/odom has 2 publishers"
    message = "40 of 100 frames were dropped"
    odometry.take_report(report(TrackingState.TRACKING, message, now_ns))
    assert odometry.reason(now_ns) == message
    assert odometry.line(now_ns).startswith("tracking, 20.0 Hz")


@pytest.mark.parametrize("state", [TrackingState.LOST, TrackingState.INITIALIZING])
def test_why_there_was_no_pose_is_not_shown_beside_a_later_one(state: TrackingState) -> None:
    odometry = watched()
    odometry.take_report(report(state, f"{state.value}: it is dark", 3 * NANOSECONDS))
    odometry.take_pose(pose(3 * NANOSECONDS + 50 * MS))
    assert odometry.reason(3 * NANOSECONDS + 60 * MS) == ""
    assert odometry.line(3 * NANOSECONDS + 60 * MS).startswith("tracking")


def test_that_no_frame_arrived_is_not_shown_beside_a_later_pose() -> None:
    odometry = watched()
    message = "No frame for 5 s: /rgb/image has no publisher"
    values = Monitor(lambda: 0).values(0) | {"state": "tracking"}
    for is_stale, reason in ((True, ""), (False, message)):
        read = Report.parse(message, values, 3 * NANOSECONDS, is_stale=is_stale)
        assert read is not None
        odometry.take_report(read)
        assert odometry.reason(3 * NANOSECONDS) == reason
        assert odometry.reason(5 * NANOSECONDS + 1) == message


def test_while_the_node_prepares_silence_is_no_fault() -> None:
    odometry = WatchedOdometry()
    odometry.silence = "no message on /odom arrived"
    state = TrackingState.INITIALIZING
    odometry.take_report(report(state, "initializing", 0))
    assert (odometry.line(0), odometry.reason(0)) == ("no pose yet, initializing", "")
    odometry.take_report(report(state, "initializing: warming up", 0))
    assert odometry.reason(0) == "warming up"


@pytest.mark.parametrize(
    ("before", "now", "is_one_run"),
    [
        ((5, 7), (6, 8), True),
        ((5, 7), (5, 8), True),
        ((5, None), (5, None), True),
        ((5, 7), (6, None), True),
        ((5, 7), (6, 1), False),
        ((5, 7), (6, 7), False),
        ((5, 7), (4, 8), False),
        ((5, None), (4, None), False),
    ],
)
def test_a_message_whose_stamp_or_number_goes_back_is_of_a_new_run(
    before: tuple[int, int | None], now: tuple[int, int | None], is_one_run: bool
) -> None:
    odometry = watched()
    assert odometry.follows(*before)
    assert odometry.follows(*now) == is_one_run
    assert odometry.line(3 * NANOSECONDS).startswith("tracking" if is_one_run else "no pose yet")
    assert odometry.count == 61


def test_a_status_of_something_else_is_no_report() -> None:
    values = Monitor(lambda: 0).values(0)
    assert Report.parse("tracking", values, 0) is not None
    assert Report.parse("tracking", {**values, "state": "dancing"}, 0) is None
    assert Report.parse("OK", {"temperature": "40"}, 0) is None


def test_a_report_keeps_the_counts_of_the_node() -> None:
    read = report(TrackingState.LOST, "lost: x", 5)
    assert read == replace(read, reason="x", arrived_ns=5)
    assert (read.summary.frames, read.summary.drops[Drop.SUPERSEDED]) == (1, 0)
