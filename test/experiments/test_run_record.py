"""What is kept of a run, and its figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rgbd_glue_ros.experiments.replay.run_record import FrameRecord, Run, metrics
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.types import (
    Correspondences,
    OdometryEstimate,
    PoseGraphEdge,
    RegistrationResult,
    RegistrationStatus,
    TrackingState,
)

TRACKING, LOST = TrackingState.TRACKING, TrackingState.LOST


def registered(x: float, parent: int, child: int) -> OdometryEstimate:
    """A keyframe ``x`` metres along, tracked from another one."""
    T = se3.exp(np.array([x, 0, 0, 0, 0, 0]))
    matches = Correspondences(np.zeros((4, 3)), np.zeros((4, 3)), np.ones(4))
    none = Correspondences.empty()
    result = RegistrationResult(None, RegistrationStatus.OK, matches, matches, matches, none)
    return OdometryEstimate(
        int(x * 1e9),
        TRACKING,
        T,
        is_keyframe=True,
        keyframe_id=parent,
        registration=result.accepted(np.eye(4), np.eye(6)),
        edges=(PoseGraphEdge(parent, child, T, np.eye(6)),),
    )


def test_the_pose_graph_has_the_keyframes_and_what_was_measured_between_them() -> None:
    run = Run("x", Config())
    run.add(OdometryEstimate(0, TRACKING, np.eye(4), is_keyframe=True), 1.0)
    run.add(registered(0.5, 0, 1), 1.0)
    run.add(OdometryEstimate(1, LOST), 1.0)
    run.add(registered(0.8, 1, 2), 1.0)
    graph = run.pose_graph
    assert len(graph.keyframes) == 3
    assert [(edge.parent, edge.child) for edge in graph.edges] == [(0, 1), (1, 2)]


def test_a_record_keeps_counts_and_no_correspondences() -> None:
    record = FrameRecord.of(registered(0.5, 0, 1), 12.5)
    assert (record.visual_inliers, record.credible, record.latency_ms) == (4, 0, 12.5)
    covariance = np.diag([1.0, 4, 9, 16, 25, 36])
    posed = OdometryEstimate(0, TRACKING, np.eye(4), covariance=covariance)
    np.testing.assert_array_equal(FrameRecord.of(posed, 1.0).sigmas, [1, 2, 3, 4, 5, 6])
    nothing = FrameRecord.of(OdometryEstimate(0, LOST), 1.0)
    assert nothing.visual_inliers is None
    assert nothing.position_m is None


def test_a_position_is_uncertain_by_as_much_as_in_the_node_whatever_the_axes() -> None:
    covariance = np.diag([0.0, 0.0, 1, 1, 1, 1])
    covariance[:2, :2] = 2.0  # 2 m along the diagonal of x and y
    posed = OdometryEstimate(0, TRACKING, np.eye(4), covariance=covariance)
    assert FrameRecord.of(posed, 1.0).position_m == pytest.approx(2)


def test_frames_that_are_uncertain_from_their_keyframe_have_not_shown_the_motion() -> None:
    run = Run("x", Config(), wall_s=1.0)
    for sigma_m in (0.01, 0.24, 0.26, 3.0):
        covariance = np.diag([0.0, sigma_m, 0.0, 0.0, 0.0, 0.0]) ** 2
        posed = OdometryEstimate(0, TRACKING, np.eye(4), np.eye(6) * 9)
        run.add(replace(posed, covariance_from_keyframe=covariance), 1.0)
    run.add(OdometryEstimate(1, LOST), 1.0)
    assert [frame.from_keyframe_m for frame in run.unseen_motion] == pytest.approx([0.26, 3.0])
    assert metrics(run, None)["unseen_motion"] == 2


def test_restarts_at_the_last_pose_are_counted_and_the_first_frame_of_a_part_is_none() -> None:
    run = Run("x", Config(), wall_s=1.0)
    start = OdometryEstimate(0, TRACKING, np.eye(4), np.eye(6), is_keyframe=True)
    for estimate in (start, registered(0.5, 0, 1), OdometryEstimate(1, LOST), start):
        run.add(estimate, 1.0)
    run.start_anew()
    run.add(start, 1.0)
    figures = metrics(run, None)
    assert (figures["blind_restarts"], figures["restarts"]) == (1, 1)


def test_figures_count_states_and_take_percentiles_and_medians_per_stage() -> None:
    run = Run("x", Config(), wall_s=2.0)
    for i in range(101):
        stages = {"fit": float(i), "rare": 7.0} if i == 50 else {"fit": float(i)}
        state = LOST if i % 4 == 0 else TRACKING
        run.frames.append(FrameRecord(i, state, None, float(i), stages_ms=stages))
    figures = metrics(run, None)
    assert (figures["frames"], figures["tracked"], figures["lost"]) == (101, 75, 26)
    assert figures["fps"] == 50.5
    assert figures["latency_ms"] == {"p50": 50.0, "p95": 95.0, "p99": 99.0, "max": 100.0}
    assert figures["stages_ms"] == pytest.approx({"fit": 50.0, "rare": 7.0})
    assert figures["path_m"] == 0.0
    assert figures["peak_rss_mb"] > 10
    assert "ape" not in figures
