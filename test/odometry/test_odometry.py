"""Odometry: exact on what it sees, silent on what it does not, back where it was when found again.

The recording is real in all that matters here: noise, holes, blur, and the truth beside it.
"""

from __future__ import annotations

import gc
import multiprocessing
import signal
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from itertools import islice, pairwise
from pathlib import Path
from typing import Any
from weakref import ref

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rigs.bag_frames import errors, halved, recorded_frames, true_poses
from rigs.room import panned_frame, room_frame, true_pose
from rigs.unseen import blacked_out, covered, without_depth

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.trajectory_errors import evaluate
from rgbd_glue_ros.experiments.bench.passer_by import PasserBy
from rgbd_glue_ros.features import VISUAL
from rgbd_glue_ros.features.visual import (
    DescribedKeypoints,
    OpenCvFeature,
    VisualMatches,
    orb_detector,
)
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config, FeaturesConfig, load_preset, with_values
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.types import (
    NANOSECONDS,
    CameraIntrinsics,
    OdometryEstimate,
    RegistrationResult,
    RgbdFrame,
    TrackingState,
    Trajectory,
    View,
)

PERIOD_NS = NANOSECONDS // 30
LOST, TRACKING = TrackingState.LOST, TrackingState.TRACKING
# waits for ever, so that what is lost stays lost until it is found
PATIENT = with_values(Config(), {"odometry.reset_countdown": 0})


def track(
    frames: Iterable[RgbdFrame], config: Config = PATIENT, odometry: Odometry | None = None
) -> list[OdometryEstimate]:
    if odometry is not None:
        return [odometry.process(frame) for frame in frames]
    with Odometry(config) as own:
        return track(frames, odometry=own)


@lru_cache(maxsize=1)
def tracked() -> tuple[OdometryEstimate, ...]:
    """What the whole recording gives."""
    return tuple(track(recorded_frames()))


def test_a_caller_that_modifies_an_estimate_does_not_affect_later_ones() -> None:
    frames = recorded_frames()[:6]
    with Odometry(PATIENT) as odometry:
        for frame in frames:
            estimate = odometry.process(frame)
            arrays = (
                estimate.T_odom_camera,
                estimate.covariance,
                estimate.twist,
                estimate.twist_covariance,
            )
            for array in arrays:
                if array is not None:
                    array[:] = 57.3
        last = odometry.process(recorded_frames()[6])
    np.testing.assert_array_equal(last.T_odom_camera, tracked()[6].T_odom_camera)


@pytest.mark.slow
def test_the_timing_error_of_images_does_not_accumulate_over_keyframes() -> None:
    """Each is off by its own error, and no later one by those of others."""
    # a Kinect, whose timing is known
    frames = [replace(f, frame_id="openni_rgb_optical_frame") for f in recorded_frames()]
    late_s = Config().odometry.timing_error
    exact, late = (
        track(frames, with_values(PATIENT, {"odometry.timing_error": seconds}))
        for seconds in (0.0, late_s)
    )
    assert len({estimate.keyframe_id for estimate in late}) > 3
    for before, estimate in zip(exact[1:], late[1:], strict=True):
        np.testing.assert_array_equal(before.T_odom_camera, estimate.T_odom_camera)
        assert before.covariance is not None
        assert estimate.covariance is not None
        assert estimate.twist is not None
        added = np.trace((estimate.covariance - before.covariance)[3:, 3:])
        of_this_image = 3 * (late_s * np.linalg.norm(estimate.twist[3:])) ** 2
        assert added == pytest.approx(of_this_image, rel=0.01)


def test_a_closed_odometry_raises_an_error() -> None:
    odometry = Odometry(PATIENT)
    odometry.process(recorded_frames()[0])
    odometry.close()
    odometry.reset()
    with pytest.raises(InputError, match="the odometry: was closed; create another one"):
        track(recorded_frames()[1:3], odometry=odometry)
    with pytest.raises(InputError, match="the odometry: was closed; create another one"):
        odometry.update_map()


def test_parameters_that_are_fixed_while_frames_are_tracked_cannot_be_changed() -> None:
    with Odometry(PATIENT) as odometry:
        odometry.process(recorded_frames()[0])
        odometry.reconfigure(with_values(PATIENT, {"glue.k": 4.0}))
        with pytest.raises(InputError, match=r"^features.visual: cannot change from 'orb' to"):
            odometry.reconfigure(with_values(PATIENT, {"features.visual": "none"}))


def test_an_odometry_of_another_process_raises_an_error_and_does_not_wait_for_its_threads() -> None:
    with Odometry(PATIENT) as odometry:
        odometry.process(recorded_frames()[0])
        receiver, sender = multiprocessing.Pipe(duplex=False)

        def use() -> None:
            try:
                odometry.process(recorded_frames()[1])
            except InputError as error:
                sender.send(str(error))

        child = multiprocessing.get_context("fork").Process(target=use)
        child.start()
        assert receiver.poll(30.0)
        assert "was created in another process" in receiver.recv()
        child.join(30.0)
        assert child.exitcode == 0


def another_room(count: int) -> list[RgbdFrame]:
    """A wavy wall with a poster, which a camera passes at 3 pixels a frame."""
    K = recorded_frames()[0].intrinsics
    rng = np.random.default_rng(0)
    poster = np.kron(rng.integers(0, 256, (K.height // 8, K.width, 3)), np.ones((8, 8, 1)))
    v, u = np.mgrid[: K.height, : 8 * K.width]
    wall = 1.2 + 0.1 * np.sin(u / 40) * np.cos(v / 30)
    frames = []
    for i in range(count):
        window = np.s_[:, 3 * i : 3 * i + K.width]
        color, depth = poster[window].astype(np.uint8), wall[window].astype(np.float32)
        frames.append(RgbdFrame(0, color, depth, K))
    return frames


def turned_over(frame: RgbdFrame) -> RgbdFrame:
    """What the camera sees when it is held upside down."""
    K = frame.intrinsics
    camera = replace(K, cx=K.width - 1 - K.cx, cy=K.height - 1 - K.cy)
    return replace(
        frame,
        color=np.ascontiguousarray(frame.color[::-1, ::-1]),
        depth=np.ascontiguousarray(frame.depth[::-1, ::-1]),
        intrinsics=camera,
    )


def numbered(frames: Iterable[RgbdFrame]) -> list[RgbdFrame]:
    """The frames at 30 Hz, whenever they were taken."""
    return [replace(frame, stamp_ns=(1 + i) * PERIOD_NS) for i, frame in enumerate(frames)]


def assert_no_pose(estimate: OdometryEstimate) -> None:
    assert estimate.T_odom_camera is None
    assert estimate.covariance is None
    assert estimate.twist is None
    assert estimate.twist_covariance is None
    assert not estimate.is_keyframe


# what is seen well


def test_the_first_frame_is_the_origin() -> None:
    first = tracked()[0]
    assert first.state is TRACKING
    np.testing.assert_array_equal(first.T_odom_camera, np.eye(4))
    assert first.is_keyframe
    assert first.keyframe_id == 0
    assert first.twist is None
    assert first.registration is None


def test_hand_held_motion_is_tracked_to_a_centimetre() -> None:
    assert {estimate.state for estimate in tracked()} == {TRACKING}
    metres, radians = errors(tracked(), true_poses())
    # quantised depth at 2.5 m has a noise of 10 mm
    assert np.sqrt(np.mean(metres**2)) < 0.01
    assert metres.max() < 0.02
    assert radians.max() < 0.01


def test_every_estimate_has_the_stamp_of_its_frame_and_the_times_of_its_stages() -> None:
    for frame, estimate in zip(recorded_frames(), tracked(), strict=True):
        assert estimate.stamp_ns == frame.stamp_ns
        assert min(estimate.stages_ms.values()) >= 0
    assert {"preparation", "ransac", "refinement", "keyframe"} <= {*tracked()[-1].stages_ms}


def test_the_same_frames_give_bitwise_the_same_poses() -> None:
    for one, two in zip(tracked(), track(recorded_frames()[:45]), strict=False):
        np.testing.assert_array_equal(one.T_odom_camera, two.T_odom_camera)
        np.testing.assert_array_equal(one.covariance, two.covariance)
        np.testing.assert_array_equal(one.twist_covariance, two.twist_covariance)
        assert (one.is_keyframe, one.keyframe_id) == (two.is_keyframe, two.keyframe_id)


def test_poses_do_not_depend_on_when_the_map_is_updated_before_the_next_frame() -> None:
    with Odometry(PATIENT) as odometry:
        for i, frame in enumerate(recorded_frames()[:45]):
            estimate, expected = odometry.track(frame), tracked()[i]
            np.testing.assert_array_equal(estimate.T_odom_camera, expected.T_odom_camera)
            if i % 2:  # else the next frame has to do it
                assert (odometry.update_map() or estimate.is_keyframe) == expected.is_keyframe
                assert not odometry.update_map()


def test_a_reset_forgets_the_frame_that_the_map_waits_for() -> None:
    first, *others = (i for i, estimate in enumerate(tracked()) if estimate.is_keyframe)
    with Odometry(PATIENT) as odometry:
        for frame in recorded_frames()[first : others[0] + 1]:
            odometry.track(frame)
        odometry.reset()
        assert not odometry.update_map()


def test_an_interrupt_waits_for_the_current_frame_and_the_odometry_continues(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    frames = recorded_frames()[:6]
    glue = Glue(PATIENT)
    register = glue.register

    def interrupted(*arguments: Any) -> RegistrationResult:
        signal.raise_signal(signal.SIGINT)
        return register(*arguments)

    with Odometry(PATIENT, glue) as odometry:
        track(frames[:3], odometry=odometry)
        monkeypatch.setattr(glue, "register", interrupted)
        with pytest.raises(KeyboardInterrupt):
            odometry.process(frames[3])
        monkeypatch.undo()
        after = track(frames[4:], odometry=odometry)
    for estimate, expected in zip(after, track(frames)[4:], strict=True):
        np.testing.assert_array_equal(estimate.T_odom_camera, expected.T_odom_camera)


def test_the_twist_is_the_velocity_in_the_cameras_frame() -> None:
    poses = true_poses()
    stamps = [frame.stamp_ns for frame in recorded_frames()]
    differences = []
    for i in range(2, len(poses) - 1):
        seconds = (stamps[i + 1] - stamps[i - 1]) / NANOSECONDS
        true = se3.log(se3.inverse(poses[i - 1]) @ poses[i + 1]) / seconds
        twist = tracked()[i].twist
        assert twist is not None
        differences.append(twist - true)
    linear, angular = np.abs(differences).reshape(-1, 2, 3).transpose(1, 0, 2)
    # the hand moves at 0.4 m/s and turns at 0.4 rad/s
    assert np.median(linear) < 0.08
    assert np.median(angular) < 0.08


def test_covariances_are_positive_definite_and_grow_from_keyframe_to_keyframe() -> None:
    keyframes = {e.stamp_ns: e for e in tracked() if e.is_keyframe}
    rotation = [
        np.trace(e.covariance[3:, 3:]) for e in keyframes.values() if e.covariance is not None
    ]
    assert len(rotation) >= 3
    assert rotation == sorted(rotation)
    for estimate in tracked():
        assert estimate.covariance is not None
        np.testing.assert_allclose(estimate.covariance, estimate.covariance.T, rtol=1e-9)
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0
    for estimate in tracked()[1:]:
        assert estimate.twist_covariance is not None
        assert np.linalg.eigvalsh(estimate.twist_covariance).min() > 0


def test_errors_are_consistent_with_the_covariance() -> None:
    squares = []
    for estimate, T in zip(tracked()[1:], true_poses()[1:], strict=True):
        assert estimate.T_odom_camera is not None
        assert estimate.covariance is not None
        moved = estimate.T_odom_camera[:3, 3] - T[:3, 3]
        turned = se3.log(estimate.T_odom_camera @ se3.inverse(T))[3:]
        error = np.concatenate([moved, turned])
        squares.append(error @ np.linalg.solve(estimate.covariance, error))
    # chi-square with six degrees of freedom, whose mean is 6, were there nothing but noise; it errs
    # by a millimetre here and expects seven, since other cameras are worse
    assert 0.05 < np.mean(squares) < 6


@pytest.mark.parametrize(
    ("visual", "geometric"), [("none", "fpfh_grid"), ("orb", "none"), ("none", "none")]
)
def test_either_feature_may_be_left_out(visual: str, geometric: str) -> None:
    config = with_values(PATIENT, {"features.visual": visual, "features.geometric": geometric})
    estimates = track(recorded_frames()[:30], config)
    metres, _ = errors(estimates, true_poses()[:30])
    assert metres.max() < 0.02


class CountingFeature(OpenCvFeature):
    """ORB that counts what is asked of it."""

    extracted = 0
    matched = 0

    def extract(self, view: View) -> DescribedKeypoints:
        self.extracted += 1
        return super().extract(view)

    def match(self, source: DescribedKeypoints, target: DescribedKeypoints) -> VisualMatches:
        self.matched += 1
        return super().match(source, target)


def test_features_of_a_frame_are_computed_once_and_kept_by_its_keyframe(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What a slow network says of an image is asked for once."""
    feature = CountingFeature(orb_detector(FeaturesConfig()), FeaturesConfig())
    monkeypatch.setitem(VISUAL, "orb", lambda _: feature)
    config = with_values(PATIENT, {"odometry.keyframe_translation": 0.005})
    estimates = track((room_frame(time) for time in np.arange(6) / 30), config)
    assert len({estimate.keyframe_id for estimate in estimates}) > 1
    assert feature.extracted == len(estimates)
    assert feature.matched >= len(estimates) - 1


@pytest.mark.slow
def test_the_method_of_the_paper_alone_registers_frame_to_keyframe() -> None:
    frames = recorded_frames()[:12:4]
    metres, radians = errors(track(frames, load_preset("paper")), true_poses()[:12:4])
    assert metres.max() < 0.05
    assert radians.max() < 0.03


def test_grey_images_are_tracked_too() -> None:
    frames = [replace(f, color=f.color[..., 1].copy()) for f in recorded_frames()[:20]]
    metres, _ = errors(track(frames), true_poses()[:20])
    assert metres.max() < 0.02


def test_images_may_change_their_size_during_a_run() -> None:
    small = [halved(frame) for frame in recorded_frames()[10:20]]
    metres, _ = errors(track([*recorded_frames()[:10], *small]), true_poses()[:20])
    assert metres.max() < 0.03


@pytest.mark.slow
def test_depth_with_a_known_delay_is_moved_to_the_time_of_colour() -> None:
    """In every other frame by 33 ms, in which the camera moves by 13 mm and turns by 0.8 degrees.

    A delay that is always the same shifts a keyframe and the frames after it alike; what hurts is
    one that changes. The camera's own offsets are given, as estimated they make up for some of it.
    """
    config = with_values(Config(), {"time_offsets.spread": 0.0})
    frames = recorded_frames()[:46]
    late = [
        replace(frame, depth=after.depth) if i % 2 else frame
        for i, (frame, after) in enumerate(pairwise(frames))
    ]
    said = [replace(f, depth_delay_ns=PERIOD_NS) if i % 2 else f for i, f in enumerate(late)]
    truth = true_poses()[:45]
    told, untold = (np.mean(errors(track(f, config), truth)[0]) for f in (said, late))
    assert told < untold


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "icl_nuim_office_kt0",
        "rgbd_dataset_freiburg1_desk",
        "rgbd_dataset_freiburg3_structure_notexture_far",
    ],
)
def test_the_first_second_of_a_real_sequence_is_tracked(name: str, shared_data: Path) -> None:
    folder = shared_data / name
    if not folder.is_dir():
        pytest.skip(f"{name} is not there")
    with open_recording(folder) as sequence:
        estimates = track(islice(sequence, 30))
        truth = sequence.ground_truth
    assert truth is not None
    poses = [e.T_odom_camera for e in estimates if e.T_odom_camera is not None]
    assert len(poses) == 30
    stamps = np.array([estimate.stamp_ns for estimate in estimates])
    assert evaluate(Trajectory(stamps, np.array(poses)), truth).ape.rmse_m < 0.02


def test_after_a_gap_in_a_fast_turn_there_is_no_pose_instead_of_a_wrong_one(
    shared_data: Path,
) -> None:
    """In the 0.7 s that are missing the camera turns by 43 degrees."""
    with open_recording(shared_data / "rgbd_dataset_freiburg1_desk") as sequence:
        frames = list(islice(sequence, 42))
    before, after = frames[:20], frames[40:]
    states = [estimate.state for estimate in track([*before, *after])]
    assert states[: len(before)] == [TrackingState.TRACKING] * len(before)
    assert states[len(before) :] == [TrackingState.LOST] * len(after)


# keyframes


def test_a_camera_at_rest_does_not_drift_and_needs_one_keyframe() -> None:
    rng = np.random.default_rng(0)
    frame = recorded_frames()[0]
    at_rest = numbered(_noisy(frame, rng) for _ in range(60))
    estimates = track(at_rest)
    metres, radians = errors(estimates, np.tile(np.eye(4), (60, 1, 1)))
    assert metres.max() < 0.005
    assert radians.max() < 0.003
    # no later than at first
    assert metres[30:].mean() < metres[1:30].mean() + 0.001
    assert sum(estimate.is_keyframe for estimate in estimates) == 1


def test_repeated_frames_change_no_pose() -> None:
    """The second ones are given the pose of the first ones, and not that of a camera that stops."""
    once = recorded_frames()[:40]
    twice = [
        replace(frame, stamp_ns=frame.stamp_ns + i * PERIOD_NS // 2)
        for frame in once
        for i in range(2)
    ]
    doubled = track(twice)
    firsts, seconds = doubled[::2], doubled[1::2]
    metres, radians = errors(firsts, true_poses()[:40])
    assert metres.max() < 0.01
    assert radians.max() < 0.005
    # as long as it starts, the camera may be at rest
    for first, second in list(zip(firsts, seconds, strict=True))[10:]:
        np.testing.assert_array_equal(second.T_odom_camera, first.T_odom_camera)
        np.testing.assert_array_equal(second.twist, first.twist)
        assert second.stamp_ns == first.stamp_ns + PERIOD_NS // 2
        assert not second.is_keyframe


def test_a_noise_free_camera_that_stops_is_estimated_to_be_at_rest() -> None:
    moving = recorded_frames()[:30]
    still = numbered([*moving, *[moving[-1]] * 30, recorded_frames()[30]])
    *_, before, after = track(still)
    assert before.T_odom_camera is not None
    assert after.T_odom_camera is not None
    assert before.twist is not None
    assert np.abs(before.twist).max() < 0.005
    assert se3.difference(before.T_odom_camera, after.T_odom_camera) < 0.05


def _noisy(frame: RgbdFrame, rng: np.random.Generator) -> RgbdFrame:
    color = frame.color + rng.normal(0, 2, frame.color.shape)
    # in disparity, as the sensor errs: 2 mm at 1 m, 18 mm at 3 m
    depth = 1 / (1 / frame.depth.astype(np.float64) + rng.normal(0, 0.002, frame.depth.shape))
    return replace(
        frame,
        color=np.clip(color, 0, 255).astype(np.uint8),
        depth=depth.astype(np.float32),
    )


def test_keyframes_are_numbered_and_frames_name_their_keyframe() -> None:
    made = 0
    for estimate in tracked():
        assert estimate.keyframe_id in range(max(1, made))
        made += estimate.is_keyframe
    assert 2 <= made <= 20


def test_old_keyframes_are_forgotten_and_the_images_of_all_but_the_newest() -> None:
    config = with_values(PATIENT, {"odometry.keyframes": 2, "odometry.keyframe_translation": 0.02})
    estimates = []
    keypoints, features = list[ref[DescribedKeypoints]](), list[ref[FrameFeatures]]()
    with Odometry(config) as odometry:
        for frame in recorded_frames()[:40]:
            estimates.append(odometry.process(frame))
            newest = odometry.newest_keyframe
            assert newest is not None
            if estimates[-1].is_keyframe:
                keypoints.append(ref(newest.features.visual))
                features.append(ref(newest.features))
        del newest
        gc.collect()
        assert [visual() is None for visual in keypoints[-3:]] == [True, False, False]
        assert [images() is None for images in features[-3:]] == [True, True, False]
    assert sum(estimate.is_keyframe for estimate in estimates) > 4
    metres, _ = errors(estimates, true_poses()[:40])
    assert metres.max() < 0.03


def test_at_the_smallest_threshold_every_frame_becomes_a_keyframe() -> None:
    least = {"odometry.keyframe_translation": 0.001, "odometry.keyframe_rotation": 0.001}
    estimates = track(recorded_frames()[:4], with_values(PATIENT, least))
    assert [estimate.is_keyframe for estimate in estimates] == [True] * 4


# what is not seen


def assert_tracked_through(disturbed: list[RgbdFrame], metres_at_most: float) -> None:
    estimates = track(disturbed)
    metres, _ = errors(estimates, true_poses())
    for estimate in estimates:
        assert (estimate.T_odom_camera is None) == (estimate.state is LOST)
    assert np.nanmax(metres) < metres_at_most
    assert {estimate.state for estimate in estimates[-10:]} == {TRACKING}
    assert np.nanmax(metres[-10:]) < 0.02


@pytest.mark.slow
def test_a_second_in_the_dark_is_bridged_by_geometry() -> None:
    frames = recorded_frames()
    assert_tracked_through([*frames[:30], *map(blacked_out, frames[30:60]), *frames[60:]], 0.05)


@pytest.mark.slow
def test_a_second_without_depth_is_bridged_by_texture() -> None:
    frames = recorded_frames()
    assert_tracked_through([*frames[:30], *map(without_depth, frames[30:60]), *frames[60:]], 0.05)


@pytest.mark.slow
def test_a_covered_camera_is_lost_and_found_where_it_was() -> None:
    """For two seconds, after which it sees again what it saw before."""
    frames = recorded_frames()
    hidden = [covered(frames[30])] * 60
    estimates = track(numbered([*frames[:30], *hidden, *frames[30:45]]))
    for estimate in estimates[30:90]:
        assert estimate.state is LOST
        assert_no_pose(estimate)
    found = estimates[90:]
    assert {estimate.state for estimate in found[2:]} == {TRACKING}
    metres, _ = errors(found, true_poses()[30:45])
    assert np.nanmax(metres) < 0.03


@pytest.mark.slow
def test_a_camera_that_was_carried_elsewhere_in_the_dark_is_found_there() -> None:
    frames = recorded_frames()
    hidden = [covered(frames[30])] * 20
    estimates = track(numbered([*frames[:30], *hidden, *frames[95:105]]))
    found = estimates[50:]
    assert {estimate.state for estimate in found[3:]} == {TRACKING}
    metres, _ = errors(found, true_poses()[95:105])
    assert np.nanmax(metres) < 0.03


def test_a_camera_that_was_turned_upside_down_is_found() -> None:
    frames = recorded_frames()
    estimates = track(numbered([*frames[:20], *map(turned_over, frames[20:30])]))
    metres, radians = errors(estimates[20:], true_poses()[20:30] @ np.diag([-1, -1, 1, 1]))
    assert {estimate.state for estimate in estimates[23:]} == {TRACKING}
    assert np.nanmax(metres) < 0.03
    assert np.nanmax(radians) < 0.02


def test_frames_too_far_apart_for_their_stamps_are_tracked() -> None:
    """As recordings whose frames are numbered and not stamped, with most of them left out."""
    step = 10
    truth = true_poses()[::step]
    way = np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1)
    assert way.max() > 0.1  # 3 m/s from standing still
    estimates = track(numbered(recorded_frames()[::step]))
    assert {estimate.state for estimate in estimates} == {TRACKING}
    metres, _ = errors(estimates, truth)
    assert metres.max() < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("somebody", [PasserBy(period=3.5), PasserBy(distance=1.0, period=2.5)])
def test_a_person_who_walks_by_is_not_followed(somebody: PasserBy) -> None:
    frames = recorded_frames()
    crossed = [somebody.before(frame, frames[0].stamp_ns) for frame in frames]
    hidden = [(a.depth != b.depth).mean() for a, b in zip(frames, crossed, strict=True)]
    assert max(hidden) > 0.3
    estimates = track(crossed)
    assert {estimate.state for estimate in estimates} == {TRACKING}
    metres, radians = errors(estimates, true_poses())
    assert metres.max() < 0.02
    assert radians.max() < 0.02


@pytest.mark.slow
def test_in_another_room_no_pose_is_invented() -> None:
    frames = recorded_frames()
    estimates = track(numbered([*frames[:20], *another_room(20)]))
    for estimate in estimates[20:]:
        assert estimate.state is LOST
        assert_no_pose(estimate)


def test_after_the_countdown_the_odometry_restarts_at_the_last_pose_with_a_grown_covariance() -> (
    None
):
    config = with_values(Config(), {"odometry.reset_countdown": 5, "odometry.reset_delay": 0})
    frames = recorded_frames()
    estimates = track(numbered([*frames[:20], *another_room(20)]), config)
    assert [estimate.state for estimate in estimates[20:24]] == [LOST] * 4
    last, again = estimates[19], estimates[24]
    assert again.state is TRACKING
    assert again.is_keyframe
    numbers = [e.keyframe_id for e in estimates[:20] if e.keyframe_id is not None]
    assert again.keyframe_id == 1 + max(numbers)
    np.testing.assert_array_equal(again.T_odom_camera, last.T_odom_camera)
    assert last.covariance is not None
    assert again.covariance is not None
    assert np.linalg.eigvalsh(again.covariance - last.covariance).min() > 0
    # a sixth of a second, at a metre a second
    assert np.sqrt(again.covariance[0, 0]) > 0.1
    # and goes on from there: the motion in the other room is that of the camera
    assert {estimate.state for estimate in estimates[24:]} == {TRACKING}


def test_the_restart_waits_while_nothing_is_visible() -> None:
    config = with_values(Config(), {"odometry.reset_countdown": 5, "odometry.reset_delay": 0})
    frames = recorded_frames()
    hidden = [covered(frames[20])] * 20
    estimates = track(numbered([*frames[:20], *hidden, *another_room(5)]), config)
    assert {estimate.state for estimate in estimates[20:44]} == {LOST}
    assert estimates[44].state is TRACKING
    assert estimates[44].is_keyframe


@pytest.mark.slow
@pytest.mark.every_python
def test_a_lost_camera_is_found_at_a_place_from_many_keyframes_ago() -> None:
    config = with_values(PATIENT, {"odometry.relocalisation_attempts": 2})
    way = [panned_frame(radians) for radians in np.arange(0, 1.5, 0.1)]
    estimates = track(numbered([*way, covered(way[-1]), *[panned_frame(0.02)] * 6]), config)
    assert sum(e.is_keyframe for e in estimates[:15]) >= 5
    found = [e for e in estimates[16:] if e.state is TRACKING]
    assert found
    assert estimates[16].state is LOST  # the latest keyframes do not show that place
    for estimate in found:
        T = estimate.T_odom_camera
        assert T is not None
        error = se3.inverse(se3.exp(np.array([0, 0, 0, 0, 0.02, 0]))) @ T
        assert np.linalg.norm(error[:3, 3]) < 0.02
        assert se3.rotation_angle(error) < 0.01


@pytest.mark.slow
def test_a_camera_found_where_only_an_early_keyframe_was_stays_found() -> None:
    config = with_values(PATIENT, {"odometry.relocalisation_attempts": 1})
    way = [panned_frame(radians) for radians in np.arange(0, 3.0, 0.1)]
    # each searches at another keyframe, and the seventh leaves it at the first one's turn
    nowhere = another_room(7)
    estimates = track(numbered([*way, *nowhere, *[panned_frame(0.02)] * 5]), config)
    assert [e.state for e in estimates[len(way) :]] == [LOST] * 7 + [TRACKING] * 5


def test_odometry_starts_with_the_first_frame_that_has_depth() -> None:
    frames = recorded_frames()[:8]
    estimates = track([*map(without_depth, frames[:3]), *frames[3:]])
    for estimate in estimates[:3]:
        assert estimate.state is TrackingState.INITIALIZING
        assert_no_pose(estimate)
    np.testing.assert_array_equal(estimates[3].T_odom_camera, np.eye(4))
    assert estimates[3].keyframe_id == 0


def test_after_a_reset_the_next_frame_is_the_origin() -> None:
    with Odometry(PATIENT) as odometry:
        track(recorded_frames()[:10], odometry=odometry)
        odometry.reset()
        assert odometry.state is TrackingState.INITIALIZING
        again = track(recorded_frames()[5:8], odometry=odometry)
    np.testing.assert_array_equal(again[0].T_odom_camera, np.eye(4))
    fresh = track(recorded_frames()[5:8])
    np.testing.assert_array_equal(again[2].T_odom_camera, fresh[2].T_odom_camera)


# what is no frame of this time


@pytest.mark.parametrize("earlier_ns", [0, 1, PERIOD_NS, 10 * NANOSECONDS])
def test_a_frame_that_is_not_later_is_refused_and_changes_nothing(earlier_ns: int) -> None:
    frames = recorded_frames()[:6]
    late = replace(frames[4], stamp_ns=frames[4].stamp_ns - earlier_ns)
    with Odometry(PATIENT) as odometry:
        track(frames[:5], odometry=odometry)
        with pytest.raises(InputError, match="not later than the frame before"):
            odometry.process(late)
        last = odometry.process(frames[5])
    np.testing.assert_array_equal(last.T_odom_camera, tracked()[5].T_odom_camera)


def test_time_advances_while_lost_too() -> None:
    frames = recorded_frames()[:6]
    with Odometry(PATIENT) as odometry:
        track([*frames[:5], covered(frames[5])], odometry=odometry)
        with pytest.raises(InputError, match="not later than the frame before"):
            odometry.process(frames[5])


@given(
    height=st.integers(1, 40),
    width=st.integers(1, 40),
    depths=st.sampled_from([0.0, -1.0, 0.5, 2.0, 7.9, 1e30, np.inf, -np.inf, np.nan]),
    seed=st.integers(0, 2**32 - 1),
)
@example(height=20, width=12, depths=2.0, seed=8397202)  # the search runs to a pose far off
@example(height=20, width=12, depths=0.0, seed=1)
@example(height=30, width=6, depths=0.0, seed=30)
@settings(max_examples=40)
def test_images_of_any_size_and_content_do_not_stop_the_odometry(
    height: int, width: int, depths: float, seed: int
) -> None:
    """Of any size and with any content."""
    rng = np.random.default_rng(seed)
    config = with_values(
        Config(),
        {
            "odometry.min_planes": 1,
            "odometry.reset_countdown": 2,
            "odometry.reset_delay": 0,
        },
    )
    camera = CameraIntrinsics(width, height, 30.0, 30.0, width / 2, height / 2)
    frames = []
    for i in range(4):
        color = rng.integers(0, 256, (height, width, 3), np.uint8)
        depth = np.where(rng.random((height, width)) < 0.2, depths, rng.uniform(1, 1.2)).astype(
            np.float32
        )
        frames.append(RgbdFrame(i * PERIOD_NS, color, depth, camera))
    for estimate in track(frames, config):
        if estimate.T_odom_camera is not None:
            assert estimate.covariance is not None
            assert np.isfinite(estimate.T_odom_camera).all()
            assert np.isfinite(estimate.covariance).all()


@pytest.mark.slow
def test_a_guess_that_is_off_a_rotation_leaves_poses_that_are_one() -> None:
    # as of an extrinsic that somebody wrote down with four digits
    rough = np.diag([1.0004, 1.0004, 1.0004, 1.0])
    with Odometry(PATIENT) as odometry:
        for frame in recorded_frames()[:10]:
            T = odometry.process(frame, rough).T_odom_camera
            assert T is not None
            np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)


def test_motion_from_another_odometry_helps_where_images_alone_fail() -> None:
    # walls without a pattern, and a third of a metre and a third of a radian between the frames
    first, second = (blacked_out(room_frame(time_s)) for time_s in (0.0, 2.4))
    with Odometry(PATIENT) as alone:
        alone.process(first)
        assert alone.process(second).state is LOST
    elsewhere = se3.exp(np.array([5.0, -3.0, 1.0, 0.2, -0.4, 2.0]))  # in a frame of its own
    with Odometry(PATIENT) as led:
        led.process(first, elsewhere @ true_pose(0.0))
        T = led.process(second, elsewhere @ true_pose(2.4)).T_odom_camera
    assert T is not None
    error = se3.inverse(T) @ se3.inverse(true_pose(0.0)) @ true_pose(2.4)
    assert np.linalg.norm(error[:3, 3]) < 0.01


@pytest.mark.slow
def test_with_the_motion_of_another_odometry_the_velocity_is_that_of_the_camera() -> None:
    frames, truth = recorded_frames()[:40], true_poses()
    with Odometry(PATIENT) as odometry:
        estimates = [odometry.process(f, T) for f, T in zip(frames, truth, strict=False)]
    for i in range(5, 39):
        passed_s = (frames[i + 1].stamp_ns - frames[i - 1].stamp_ns) / NANOSECONDS
        velocity = se3.log(se3.inverse(truth[i - 1]) @ truth[i + 1]) / passed_s
        twist, covariance = estimates[i].twist, estimates[i].twist_covariance
        assert twist is not None
        assert covariance is not None
        assert (np.abs(twist - velocity) < 3 * np.sqrt(np.diag(covariance))).all()
        np.testing.assert_allclose(twist, velocity, atol=0.12)
