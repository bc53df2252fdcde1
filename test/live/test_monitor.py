"""What the node says of itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rgbd_glue_ros.live.frame_counts import Drop, Summary
from rgbd_glue_ros.live.load import Load
from rgbd_glue_ros.live.monitor import Monitor
from rgbd_glue_ros.messages.fault_news import FAULTS_WINDOW_NS, MAX_FAULTS
from rgbd_glue_ros.types import ImuCalibration, ImuUse, OdometryEstimate, TrackingState

MS = 1_000_000
POSE = OdometryEstimate(0, TrackingState.TRACKING, T_odom_camera=np.eye(4))
NO_POSE = OdometryEstimate(0, TrackingState.LOST)


def test_latency_percentiles_and_rate_are_those_of_the_frames_counted() -> None:
    monitor = Monitor()
    for i in range(150):
        done = (1000 + 40 * i) * MS  # 25 Hz
        monitor.processed(POSE, done - (i + 1) * MS, done)
    summary = monitor.summary((1000 + 40 * 149) * MS)
    assert summary.frames == summary.tracked == 150
    assert summary.latency_p50_ms == pytest.approx(75.5)
    assert summary.latency_p95_ms == pytest.approx(np.percentile(np.arange(1, 151), 95))
    assert summary.rate_hz == pytest.approx(25)


def test_the_rate_falls_to_zero_when_frames_stop() -> None:
    monitor = Monitor()
    monitor.processed(POSE, 0, MS)
    assert monitor.summary(3600_000 * MS).rate_hz == 0


def test_frames_without_a_pose_and_dropped_frames_are_counted_separately() -> None:
    monitor = Monitor()
    monitor.processed(NO_POSE, 0, MS)
    monitor.dropped(Drop.SUPERSEDED)
    monitor.dropped(Drop.SUPERSEDED)
    monitor.dropped(Drop.UNUSABLE)
    summary = monitor.summary(MS)
    assert (summary.state, summary.frames, summary.tracked) == (TrackingState.LOST, 1, 0)
    assert summary.drops == dict.fromkeys(Drop, 0) | {
        Drop.SUPERSEDED: 2,
        Drop.UNUSABLE: 1,
        Drop.FAILED: 0,
    }
    assert "2 because a newer frame came" in str(summary)


def test_a_summary_is_read_back_from_diagnostics_values() -> None:
    monitor = Monitor()
    monitor.processed(POSE, 0, 12 * MS)
    monitor.dropped(Drop.FAILED)
    summary = monitor.summary(20 * MS)
    assert Summary.parse({**summary.values(), "color: received": "7"}) == summary


def test_a_summary_before_the_first_frame_can_be_printed() -> None:
    assert str(Monitor().summary(0)) == "0 frames, 0 tracked; dropped none"


def test_a_fault_is_new_only_once_and_the_memory_of_faults_is_bounded() -> None:
    monitor = Monitor(lambda: 0)
    assert monitor.is_news("/rgb/image", "100 bytes instead of 900")
    assert not monitor.is_news("/rgb/image", "120 bytes instead of 900")
    news = [monitor.is_news("/rgb/image", "x" * i) for i in range(500)]
    assert sum(news) == MAX_FAULTS - 1


def test_after_a_flood_of_faults_a_new_one_is_reported_again() -> None:
    now_ns = 0
    monitor = Monitor(lambda: now_ns)
    assert sum(monitor.is_news("/rgb/image", "x" * i) for i in range(500)) == MAX_FAULTS
    assert not monitor.is_news("/depth", "cut off")
    now_ns += FAULTS_WINDOW_NS
    assert monitor.is_news("/depth", "cut off")
    assert not monitor.is_news("/depth", "cut off")


def test_the_age_of_the_last_pose_is_measured_by_the_clock_not_by_stamps() -> None:
    now_ns = 5000 * MS
    monitor = Monitor(lambda: now_ns)
    assert monitor.values(now_ns + 700 * MS)["without_pose_s"] == "0.700"
    monitor.processed(replace(POSE, stamp_ns=10**18), now_ns, now_ns)
    monitor.processed(replace(NO_POSE, stamp_ns=0), now_ns, now_ns + 1000 * MS)
    monitor.is_news("/depth", "cut off")
    values = monitor.values(now_ns + 2500 * MS)
    assert (values["without_pose_s"], values["last_error"]) == ("2.500", "/depth: cut off")
    assert monitor.is_overdue(now_ns + 2500 * MS)
    assert not monitor.is_overdue(now_ns + 500 * MS)


def test_frames_that_are_all_refused_are_reported_with_what_refused_the_last() -> None:
    monitor = Monitor(lambda: 0)
    monitor.processed(POSE, 0, 0)
    monitor.dropped(Drop.UNUSABLE, "/rgb/image: bayer_rggb8 is not known")
    monitor.is_news("/imu", "has no stamp")
    assert monitor.why_refused(1000 * MS) == ""
    why = monitor.why_refused(7000 * MS)
    assert why == (
        "no frame was processed for 7 s, because a message could not be used: "
        "/rgb/image: bayer_rggb8 is not known"
    )
    monitor.processed(NO_POSE, 0, 7000 * MS)
    assert monitor.why_refused(7000 * MS) == ""


def test_frames_left_out_while_others_wait_for_the_pose_of_the_camera_are_not_the_cause() -> None:
    monitor = Monitor(lambda: 0)
    unplaced = "because the camera's pose on the robot was not known yet"
    for _ in range(3):
        monitor.dropped(Drop.UNPLACED)
        for _ in range(2):
            monitor.dropped(Drop.SUPERSEDED)
            assert monitor.why_refused(7000 * MS).endswith(unplaced)
    monitor.processed(POSE, 0, 7000 * MS)
    monitor.dropped(Drop.SUPERSEDED)
    assert monitor.why_refused(14_000 * MS).endswith(
        "because a newer frame came while the odometry was busy"
    )


def test_a_lost_camera_is_not_reported_as_an_overload() -> None:
    monitor = Monitor(lambda: 0)
    monitor.processed(POSE, 0, 0)
    # a slow computer, on which a newer frame comes within each
    for at_ms in range(60, 30_000, 60):
        monitor.processed(NO_POSE, (at_ms - 60) * MS, at_ms * MS, "it shows no structure")
        monitor.dropped(Drop.SUPERSEDED)
    assert monitor.why_refused(30_000 * MS) == ""
    assert monitor.why_no_pose == "it shows no structure"
    assert monitor.is_overdue(30_000 * MS)
    assert monitor.why_refused(33_000 * MS).startswith("no frame was processed for 3 s, because a")


def test_frames_left_out_during_a_search_are_not_blamed_on_the_machine() -> None:
    monitor = Monitor(lambda: 0)

    def process(estimate: OdometryEstimate, left_out: int) -> None:
        for _ in range(left_out):
            monitor.dropped(Drop.SUPERSEDED)
        monitor.processed(estimate, 0, 0)

    # the first frame waits for a compiler
    monitor.dropped(Drop.SUPERSEDED)
    assert monitor.load == Load(0, 1)
    process(POSE, 1)
    process(POSE, 1)
    assert monitor.load == Load(2, 3)
    # it is lost at this frame, and found at the last
    for estimate in (NO_POSE, NO_POSE, POSE):
        monitor.dropped(Drop.SUPERSEDED)
        assert monitor.load == Load(2, 3)
        process(estimate, 4)
        assert monitor.load == Load(2, 3)
    process(POSE, 1)
    assert monitor.load == Load(3, 4)
    assert monitor.summary(0).drops[Drop.SUPERSEDED] == 19


def test_frames_skipped_on_request_are_not_an_error() -> None:
    monitor = Monitor(lambda: 0)
    monitor.dropped(Drop.PAUSED)
    monitor.dropped(Drop.TOO_SOON)
    assert monitor.why_refused(7000 * MS) == ""


def test_the_imu_calibration_is_reported_with_units_unless_there_are_no_samples() -> None:
    monitor = Monitor()
    assert not [name for name in monitor.values(0) if name.startswith("imu")]
    known = ImuCalibration(
        ImuUse.TURNS, np.array([0.01, -0.02, 0.0]), np.full(3, 1e-3), 0.005, 2e-3
    )
    monitor.learnt(known)
    assert (
        monitor.values(0).items()
        >= {
            "imu_use": "turns and gravity",
            "imu_bias_rad_s": "0.010000 -0.020000 0.000000",
            "imu_time_offset_s": "0.005000",
            "imu_time_offset_sigma_s": "0.002000",
        }.items()
    )
    monitor.learnt(replace(known, use=ImuUse.NONE))
    told = {name: v for name, v in monitor.values(0).items() if name.startswith("imu")}
    assert told == {"imu_use": "no samples"}
