"""A frame waits for an optional transform only while it usually comes."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.live.patient_lookup import MOST_MISSES, PatientLookup
from rgbd_glue_ros.types import NANOSECONDS, Float64

PERIOD_NS = NANOSECONDS // 20
WAIT_S = 0.1
END_NS = 10**6 * NANOSECONDS


class Odometry:
    """Another odometry, whose pose of a stamp comes so much later than the frame, or never."""

    def __init__(self, late_ms: int | None) -> None:
        self.late_ms = late_ms
        self.now_ns = 0
        self.waits = 0

    def lookup(self, stamp_ns: int, wait_s: float) -> Float64 | None:
        wait_ns = round(wait_s * NANOSECONDS)
        comes_ns = END_NS if self.late_ms is None else stamp_ns + self.late_ms * 1_000_000
        if self.now_ns < comes_ns and wait_ns:
            self.waits += 1
            self.now_ns = min(self.now_ns + wait_ns, comes_ns)
        return np.eye(4) if self.now_ns >= comes_ns else None

    def found(self, poses: PatientLookup, count: int) -> list[bool]:
        """Whether the next frames have poses; a frame that comes during a wait is skipped."""
        has_pose = []
        for _ in range(count):
            self.now_ns += PERIOD_NS - self.now_ns % PERIOD_NS
            has_pose.append(poses.at(self.now_ns) is not None)
        return has_pose


def patient(odometry: Odometry) -> PatientLookup:
    return PatientLookup(odometry.lookup, WAIT_S, lambda: odometry.now_ns / NANOSECONDS)


def test_a_transform_that_comes_in_time_is_always_waited_for() -> None:
    odometry = Odometry(30)
    poses = patient(odometry)
    assert all(odometry.found(poses, 100))
    assert odometry.waits == 100
    assert not poses.is_missing


def test_a_transform_that_never_comes_is_waited_for_a_few_times() -> None:
    odometry = Odometry(None)
    poses = patient(odometry)
    assert not any(odometry.found(poses, 1000))
    assert odometry.waits == MOST_MISSES
    assert poses.is_missing


def test_a_transform_that_comes_again_is_waited_for_again() -> None:
    odometry = Odometry(None)
    poses = patient(odometry)
    odometry.found(poses, 100)
    odometry.late_ms = 30
    assert all(odometry.found(poses, 100)[1:])
    assert not poses.is_missing


def test_a_transform_that_always_comes_late_costs_one_wait_in_a_while() -> None:
    odometry = Odometry(250)
    poses = patient(odometry)
    assert not any(odometry.found(poses, 400))  # 20 s
    assert MOST_MISSES < odometry.waits <= MOST_MISSES + 5
    assert poses.is_missing


def test_after_time_went_back_it_is_waited_for_again() -> None:
    odometry = Odometry(None)
    poses = patient(odometry)
    odometry.found(poses, 100)
    odometry.late_ms, odometry.now_ns = 30, 0
    assert all(odometry.found(poses, 100)[2:])
