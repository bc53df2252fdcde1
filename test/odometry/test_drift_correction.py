"""DriftCorrection: found where the camera comes back, and taken out bit by bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rigs.bag_frames import errors, recorded_frames, true_poses
from rigs.geometry import transforms
from rigs.room import room_view, true_pose

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.drift_correction import DriftCorrection, Revisit, revisit
from rgbd_glue_ros.odometry.keyframe import Anchor, NewestKeyframe
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.odometry.pose_covariance import PoseErrors
from rgbd_glue_ros.odometry.surfaces import Surfaces
from rgbd_glue_ros.parameters import Config, with_values
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.types import Float64, View

CONFIG = Config()
# how a keyframe is compared with anchors
COMPARISON = (CONFIG.refine, Acceptance.of(CONFIG.odometry), PoseErrors.of(CONFIG))
STEP = se3.exp(np.array([0.02, 0, 0.01, 0, 0.03, 0]))
NONE = np.eye(4)
# of the keyframe since the anchor: some centimetres and degrees
DRIFT = se3.exp(np.array([0.04, -0.03, 0.02, 0.01, 0.02, -0.01]))


def keyframe(view: View, T_track_camera: Float64, sigma: float = 0.05) -> NewestKeyframe:
    model = model_of(view, CONFIG.refine.grid_step).moved(T_track_camera)
    features = FrameFeatures(view, None, None, {})
    surfaces = Surfaces.seen(view, T_track_camera)
    covariance = np.eye(6) * sigma**2
    return NewestKeyframe(0, 0, T_track_camera, covariance, features, model, 0, surfaces)


def anchor(view: View, T_track_camera: Float64, T_odom_track: Float64) -> Anchor:
    return Anchor.of(keyframe(view, T_track_camera), T_odom_track)


# how the pose follows


@given(target=transforms(), way=st.floats(0, 0.2), rate=st.floats(0, 1))
def test_a_pose_is_corrected_by_at_most_a_fraction_of_the_cameras_motion(
    target: Float64, way: float, rate: float
) -> None:
    before, now = NONE, se3.exp(way * np.array([1.0, 0, 0, 0, 1, 0]))
    drift = DriftCorrection(NONE, target).advanced(before, now, rate)
    moved = se3.difference(now, drift.T_odom_track @ now)
    # a screw's chord is shorter than its way
    assert moved <= rate * se3.difference(before, now) * 1.01 + 1e-9
    np.testing.assert_array_equal(drift.T_odom_track_known, target)


def test_the_pose_of_a_camera_at_rest_is_not_corrected() -> None:
    drift = DriftCorrection(NONE, DRIFT).advanced(STEP, STEP, rate=0.5)
    np.testing.assert_allclose(drift.T_odom_track, NONE, atol=1e-12)


def test_the_correction_of_a_moving_camera_is_completed_and_then_stays() -> None:
    drift, T = DriftCorrection(NONE, DRIFT), NONE
    off = []
    for _ in range(300):
        drift, T = drift.advanced(T, T @ STEP, rate=0.01), T @ STEP
        off.append(se3.difference(drift.T_odom_track @ T, DRIFT @ T))
    left = [distance for distance in off if distance > 1e-9]
    assert len(left) < len(off)
    # where the camera is turns what is left to do; it grows less all the same
    assert left[0] > left[len(left) // 3] > left[2 * len(left) // 3] > left[-1]
    np.testing.assert_array_equal(drift.T_odom_track, DRIFT)


def test_fully_corrected_drift_needs_no_further_correction() -> None:
    drift = DriftCorrection.at(DRIFT)
    advanced = drift.advanced(NONE, STEP, rate=0.01)
    np.testing.assert_array_equal(advanced.T_odom_track, DRIFT)
    np.testing.assert_array_equal(advanced.T_odom_track_known, DRIFT)


# what a comparison with an anchor shows


def tracked_back(view: View, T: Float64, sigma: float = 0.05) -> Revisit:
    """What a frame of time 0.5 s shows that is believed at T, where two anchors are of before."""
    before = [anchor(room_view(time_s), true_pose(time_s), NONE) for time_s in (0.0, 0.2)]
    return revisit(keyframe(view, T, sigma), before, NONE, *COMPARISON)


def test_a_keyframe_near_an_anchor_reveals_the_drift_since_then() -> None:
    truth = true_pose(0.5)
    drift = tracked_back(room_view(0.5), DRIFT @ truth)
    metres, radians = 0.004, 0.003
    off = se3.inverse(truth) @ drift.T_odom_track_known @ DRIFT @ truth
    assert np.linalg.norm(off[:3, 3]) < metres
    assert se3.rotation_angle(off) < radians


def test_the_drift_of_the_anchor_itself_is_taken_into_account() -> None:
    """A keyframe and an anchor that drifted alike agree, and both are where the anchor was."""
    before = [
        anchor(room_view(time_s), DRIFT @ true_pose(time_s), T_odom_track=se3.inverse(DRIFT))
        for time_s in (0.0, 0.2)
    ]
    now = keyframe(room_view(0.5), DRIFT @ true_pose(0.5))
    drift = revisit(now, before, se3.inverse(DRIFT), *COMPARISON)
    np.testing.assert_allclose(drift.T_odom_track_known, se3.inverse(DRIFT), atol=0.005)


def test_a_single_anchor_gives_an_edge_but_no_drift() -> None:
    before = anchor(room_view(0.0), true_pose(0.0), NONE)
    now = keyframe(room_view(0.5), DRIFT @ true_pose(0.5))
    drift = revisit(now, [before], NONE, *COMPARISON)
    np.testing.assert_array_equal(drift.T_odom_track_known, NONE)
    assert len(drift.edges) == 1


def test_contradicting_anchors_give_no_drift() -> None:
    right = anchor(room_view(0.0), true_pose(0.0), NONE)
    # drifted itself, twice as far: by it, the keyframe has to be corrected the other way
    wrong = anchor(room_view(0.2), true_pose(0.2), DRIFT @ DRIFT)
    now = keyframe(room_view(0.5), DRIFT @ true_pose(0.5))
    drift = revisit(now, [right, wrong], NONE, *COMPARISON)
    assert len(drift.edges) == 2
    np.testing.assert_array_equal(drift.T_odom_track_known, NONE)


def test_drift_beyond_the_covariance_means_another_place() -> None:
    drift = tracked_back(room_view(0.5), DRIFT @ true_pose(0.5), sigma=0.005)
    np.testing.assert_array_equal(drift.T_odom_track_known, NONE)


@pytest.mark.parametrize(("uncertain_axis", "is_believed"), [(0, False), (2, True)])
def test_drift_is_compared_with_the_covariance_in_the_frame_of_its_measurement(
    uncertain_axis: int, *, is_believed: bool
) -> None:
    """The odom frame is turned by 90 degrees from the track frame: its x axis is that one's z."""
    T_odom_track = se3.exp(np.array([0, 0, 0, 0, np.pi / 2, 0]))
    drift_along_x = se3.exp(np.array([0.04, 0, 0, 0, 0, 0]))
    anchors = [
        anchor(room_view(time_s), true_pose(time_s), drift_along_x @ T_odom_track)
        for time_s in (0.0, 0.2)
    ]
    covariance = np.eye(6) * 0.005**2
    covariance[uncertain_axis, uncertain_axis] = 0.05**2
    now = replace(keyframe(room_view(0.5), true_pose(0.5)), covariance=covariance)
    drift = revisit(now, anchors, T_odom_track, *COMPARISON)
    expected = drift_along_x @ T_odom_track if is_believed else T_odom_track
    np.testing.assert_allclose(drift.T_odom_track_known, expected, atol=0.005)


def test_a_view_in_which_colour_or_planes_disagree_gives_no_drift() -> None:
    view = room_view(0.5)
    dark = replace(view, grey=np.zeros_like(view.grey))
    hidden = replace(view, depth=np.full_like(view.depth, 0.5))
    for disturbed in (dark, hidden):
        drift = tracked_back(disturbed, DRIFT @ true_pose(0.5))
        np.testing.assert_array_equal(drift.T_odom_track_known, NONE)


# in the odometry


def mean_error_of_the_second_swing(radius: float) -> float:
    """Metres, where keyframes come so often that their errors add up."""
    often = {
        "odometry.keyframe_translation": 0.04,
        "odometry.keyframe_rotation": 0.04,
        "odometry.keyframe_spacing": 0.1,
        "odometry.window": 2,
        "odometry.references": 1,
        "odometry.drift_radius": radius,
    }
    odometry = Odometry(with_values(CONFIG, often))
    frames = [*recorded_frames(), *recorded_frames()]
    period_ns = frames[1].stamp_ns - frames[0].stamp_ns
    estimates = [
        odometry.process(replace(frame, stamp_ns=i * period_ns)) for i, frame in enumerate(frames)
    ]
    metres, _ = errors(estimates, np.concatenate([true_poses(), true_poses()]))
    assert np.isfinite(metres).all()
    return float(np.mean(metres[len(frames) // 2 :]))


@pytest.mark.slow
def test_a_camera_that_swings_to_and_fro_does_not_drift_away() -> None:
    assert mean_error_of_the_second_swing(0.3) < 0.5 * mean_error_of_the_second_swing(0.0)


def test_a_shift_of_the_tracked_pose_does_not_move_the_output_and_is_removed_gradually() -> None:
    T_track_camera = se3.exp(np.array([0.3, 0.1, -0.2, 0.1, 0.2, 0.3]))
    T_shift = se3.exp(np.array([0.2, 0.0, 0.0, 0.0, 0.01, 0.0]))
    before = DriftCorrection.at(se3.exp(np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.05])))
    after = before.after_shift(T_shift)
    np.testing.assert_allclose(
        after.T_odom_track @ T_shift @ T_track_camera, before.T_odom_track @ T_track_camera
    )
    np.testing.assert_allclose(after.T_odom_track_known, before.T_odom_track_known, atol=1e-12)
    remaining = after.T_odom_track_known @ se3.inverse(after.T_odom_track)
    assert 0.19 < np.linalg.norm(remaining[:3, 3]) < 0.22
    moved = after
    for i in range(100):
        T_from, T_to = (se3.exp(np.array([0.5 * j, 0, 0, 0, 0, 0])) for j in (i, i + 1))
        moved = moved.advanced(T_from, T_to, 0.01)
    np.testing.assert_allclose(moved.T_odom_track, before.T_odom_track, atol=1e-12)


@given(transforms(), transforms())
def test_known_drift_is_stated_as_what_the_published_pose_is_off_by(
    T_drift: Float64, T_track_camera: Float64
) -> None:
    """Along the error of the position, however much the drift turns, and in no other direction."""
    drift = DriftCorrection(NONE, T_drift)
    T, covariance = drift.pose_in_odom(T_track_camera, 1e-12 * np.eye(6))
    off = (T_drift @ T_track_camera)[:3, 3] - T[:3, 3]
    np.testing.assert_allclose(covariance[:3, :3], np.outer(off, off), atol=1e-9)
    turn = np.trace(covariance[3:, 3:])
    np.testing.assert_allclose(turn, se3.rotation_angle(T_drift) ** 2, atol=1e-9)
