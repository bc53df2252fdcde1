"""Parts of the robot in view are found, and nothing of the room is taken for one."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from rigs.bag_frames import errors, recorded_frames, true_poses
from rigs.room import CAMERA, room_frame, true_pose
from rigs.scenes import SCENES

from rgbd_glue_ros.experiments.bench.passer_by import PasserBy
from rgbd_glue_ros.experiments.bench.robot_part import pixels_of_part, with_robot_part
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.depth import depth_sigmas
from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.odometry.background import BackgroundThread
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.odometry.own_parts import OwnParts
from rgbd_glue_ros.odometry.own_parts_tracker import OwnPartsTracker
from rgbd_glue_ros.odometry.surfaces import BLOCK_PX, pixels_of
from rgbd_glue_ros.parameters import Config, with_values
from rgbd_glue_ros.types import Float64, RgbdFrame, View

CONFIG = Config()
TIMES_S = tuple(round(0.1 * i, 1) for i in range(13))
PART = pixels_of_part(CAMERA.height, CAMERA.width)
IN_BLOCKS = PART[BLOCK_PX // 2 :: BLOCK_PX, BLOCK_PX // 2 :: BLOCK_PX]


def after(
    frames: Iterable[RgbdFrame], poses: Iterable[Float64], known: OwnParts | None = None
) -> OwnParts:
    """What is known after frames seen from poses."""
    known = known or OwnParts()
    for frame, T in zip(frames, poses, strict=True):
        view = view_of(frame, CONFIG.camera)
        if known.needs(view, T):
            known = known.after_view(view, T)
    return known


def empty_room(times_s: Iterable[float] = TIMES_S) -> list[RgbdFrame]:
    return [room_frame(time_s) for time_s in times_s]


def with_part(times_s: Iterable[float] = TIMES_S) -> list[RgbdFrame]:
    rng = np.random.default_rng(0)
    return [with_robot_part(frame, rng) for frame in empty_room(times_s)]


def poses(times_s: Iterable[float] = TIMES_S) -> list[Float64]:
    return [true_pose(time_s) for time_s in times_s]


@pytest.fixture(scope="module")
def known() -> OwnParts:
    return after(with_part(), poses())


def test_parts_that_move_with_the_camera_are_found_block_by_block(known: OwnParts) -> None:
    assert known.blocks is not None
    found = known.blocks > 0
    assert found[IN_BLOCKS].all()
    # the blocks around it, and one more where pixels of it reach into a block
    rows, columns = np.nonzero(IN_BLOCKS)
    for row, column in zip(*np.nonzero(found), strict=True):
        apart = np.maximum(np.abs(rows - row), np.abs(columns - column))
        assert apart.min() <= 2


def test_parts_are_found_in_depth_several_times_as_noisy_as_expected() -> None:
    frames, rng = with_part(), np.random.default_rng(1)
    noises = (8 * depth_sigmas(f.depth) * rng.standard_normal(f.depth.shape) for f in frames)
    noisy = [
        replace(frame, depth=(frame.depth + noise).astype(np.float32))
        for frame, noise in zip(frames, noises, strict=True)
    ]
    found = after(noisy, poses())
    assert found.blocks is not None
    assert (found.blocks > 0)[IN_BLOCKS].mean() > 0.9


def test_own_parts_are_removed_from_depth_and_image_and_the_rest_is_kept(known: OwnParts) -> None:
    view = view_of(with_part([0.0])[0], CONFIG.camera)
    left = known.left_out(view)
    assert known.blocks is not None
    own = known.blocks.repeat(BLOCK_PX, axis=0).repeat(BLOCK_PX, axis=1) > 0
    assert np.isnan(left.depth[own]).all()
    assert np.ptp(left.grey[own]) == 0
    np.testing.assert_array_equal(left.depth[~own], view.depth[~own])
    np.testing.assert_array_equal(left.grey[~own], view.grey[~own])


def test_the_ignored_fraction_of_the_view_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    times_s = [round(0.1 * i, 1) for i in range(30)]
    with caplog.at_level(logging.WARNING):
        after(with_part(times_s), poses(times_s))
    assert 1 <= len(caplog.messages) <= 3
    assert "% of the view moves with the camera" in caplog.messages[-1]
    assert "odometry.own_parts: false" in caplog.messages[-1]


def test_after_a_part_disappears_its_pixels_are_used_again(known: OwnParts) -> None:
    times_s = (1.3, 1.4, 1.5)
    gone = after(empty_room(times_s), poses(times_s), known)
    assert gone.blocks is None


def test_a_camera_at_rest_finds_no_own_parts() -> None:
    resting = with_part([0.0] * 13)
    assert after(resting, poses([0.0] * 13)).blocks is None


def test_images_smaller_than_a_block_are_skipped() -> None:
    tiny = View(np.zeros((6, 6), np.uint8), np.ones((6, 6), np.float32), CAMERA)
    assert not OwnParts().needs(tiny, np.eye(4))
    assert OwnParts().left_out(tiny) is tiny


@pytest.mark.parametrize("shape", [(270, 480), (64, 70), (8, 15)])
def test_blocks_are_placed_every_eight_pixels_whatever_the_size_of_the_image(
    shape: tuple[int, int],
) -> None:
    rows, columns = (size // BLOCK_PX for size in shape)
    view = View(np.zeros(shape, np.uint8), np.ones(shape, np.float32), CAMERA)
    for row, column in ((0, 0), (rows // 2, columns // 2), (rows - 1, columns - 1)):
        blocks = np.zeros((rows, columns), np.uint8)
        blocks[row, column] = 1
        pixels = pixels_of(blocks, view)
        expected = np.zeros(shape, np.bool_)
        # pixels beyond the last block are in none, and taken for its own
        last_row, last_column = row == rows - 1, column == columns - 1
        expected[
            row * BLOCK_PX : None if last_row else (row + 1) * BLOCK_PX,
            column * BLOCK_PX : None if last_column else (column + 1) * BLOCK_PX,
        ] = True
        np.testing.assert_array_equal(pixels, expected)


def test_a_view_at_the_pose_of_the_last_one_is_not_needed_however_late_its_depth_is() -> None:
    twist = np.array([0.0, 0.0, 0.0, 0.0, 2.5, 0.0])
    late = replace(view_of(empty_room([0.0])[0], CONFIG.camera), twist=twist, depth_delay=0.02)
    seen = OwnParts().after_view(late, np.eye(4))
    assert not seen.needs(late, np.eye(4))
    assert seen.needs(late, se3.exp(np.array([0.1, 0, 0, 0, 0, 0])))


def test_another_image_size_restarts_the_detection(known: OwnParts) -> None:
    halved = recorded_frames()[0]
    view = view_of(replace(halved, stamp_ns=0), CONFIG.camera)
    cut = replace(view, depth=view.depth[:-16], grey=view.grey[:-16])
    assert known.after_view(cut, np.eye(4)).blocks is None


def test_poses_before_a_restart_are_not_compared(known: OwnParts) -> None:
    assert known.without_views().views == ()
    np.testing.assert_array_equal(known.without_views().blocks, known.blocks)


def test_what_a_tracker_found_is_left_out_until_it_is_switched_off() -> None:
    view = view_of(with_part([0.0])[0], CONFIG.camera)
    with closing(BackgroundThread()) as background:
        tracker = OwnPartsTracker(background, CONFIG.odometry)
        for frame, T in zip(with_part(), poses(), strict=True):
            tracker.compare(view_of(frame, CONFIG.camera), T)
        tracker.start_anew()
        assert np.isnan(tracker.left_out(view).depth[PART]).all()
        tracker.reconfigure(replace(CONFIG.odometry, own_parts=False))
        for frame, T in zip(with_part(), poses(), strict=True):
            tracker.compare(view_of(frame, CONFIG.camera), T)
        assert tracker.left_out(view) is view


@pytest.mark.slow
@pytest.mark.parametrize("place", ["a corridor walked along", "stairs", "a wide field of view"])
def test_floors_and_walls_along_which_the_camera_moves_are_not_own_parts(place: str) -> None:
    scene = SCENES[place]
    assert not after(scene.noisy_frames(seed=0), scene.true_poses()).votes.any()


@pytest.mark.slow
def test_no_surface_of_the_room_is_mistaken_for_an_own_part() -> None:
    frames = recorded_frames()
    assert after(frames, true_poses()).blocks is None


@pytest.mark.slow
@pytest.mark.parametrize("step_m", [0.02, 0.05])
@pytest.mark.parametrize("somebody", [PasserBy(), PasserBy(distance=1.0, reach=0.4, period=6.0)])
def test_a_wrong_pose_does_not_make_the_room_an_own_part(somebody: PasserBy, step_m: float) -> None:
    """The camera stands, and its pose is carried along by somebody who walks by."""
    frames = [replace(recorded_frames()[0], stamp_ns=int(1e8) * i) for i in range(30)]
    crossed = [somebody.before(frame, 0) for frame in frames]
    carried = np.tile(np.eye(4), (30, 1, 1))
    carried[:, 0, 3] = step_m * np.arange(30)
    found = after(crossed, carried)
    assert found.blocks is None


Change = Callable[[RgbdFrame, np.random.Generator], RgbdFrame]


def furthest(config: Config, change: Change) -> float:
    """How far the second half of the bundled recording is off, metres."""
    rng = np.random.default_rng(0)
    frames = recorded_frames()[:60]
    with Odometry(config) as odometry:
        estimates = [odometry.process(change(frame, rng)) for frame in frames]
    metres, _ = errors(estimates, true_poses()[:60])
    return float(metres[30:].max())


@pytest.mark.slow
def test_own_parts_do_not_hold_the_odometry_back() -> None:
    left_in = with_values(CONFIG, {"odometry.own_parts": False})
    held, found = furthest(left_in, with_robot_part), furthest(CONFIG, with_robot_part)
    assert found < 0.05
    assert found < held / 2


@pytest.mark.slow
def test_without_own_parts_the_odometry_is_bitwise_the_same() -> None:
    def as_it_is(frame: RgbdFrame, _: np.random.Generator) -> RgbdFrame:
        return frame

    left_in = with_values(CONFIG, {"odometry.own_parts": False})
    assert furthest(left_in, as_it_is) == furthest(CONFIG, as_it_is)
