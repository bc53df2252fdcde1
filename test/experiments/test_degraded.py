"""Sequences made worse: what is changed, and that nothing else is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.experiments.bench.degraded import (
    DEGRADATIONS,
    Degradation,
    DegradedSequence,
    depth_holes,
    dim,
    dropped,
    every,
    first,
    no_color,
    no_depth,
    somebody_walks_by,
)
from rgbd_glue_ros.experiments.bench.passer_by import PasserBy
from rgbd_glue_ros.recordings import Recording
from rgbd_glue_ros.recordings.recording import selected
from rgbd_glue_ros.types import NANOSECONDS, CameraIntrinsics, RgbdFrame, Trajectory

CAMERA = CameraIntrinsics(160, 120, 100.0, 100.0, 79.5, 59.5)
RATE_HZ = 10
FRAMES = 60


class Grey(Closing):
    """Six seconds of a grey wall, 2 m away."""

    name = "grey"
    frame_count = FRAMES
    ground_truth = Trajectory(np.arange(FRAMES) * NANOSECONDS, np.tile(np.eye(4), (FRAMES, 1, 1)))
    closed = False

    def __iter__(self) -> Iterator[RgbdFrame]:
        for i in range(FRAMES):
            color = np.full((120, 160, 3), 128, np.uint8)
            depth = np.full((120, 160), 2.0, np.float32)
            yield RgbdFrame(i * NANOSECONDS // RATE_HZ, color, depth, CAMERA)

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        return selected(self, indices)

    def close(self) -> None:
        self.closed = True


def degraded(degradation: Degradation) -> list[RgbdFrame]:
    return list(DegradedSequence(Grey(), degradation))


def times(frames: list[RgbdFrame]) -> list[float]:
    return [frame.stamp_ns / NANOSECONDS for frame in frames]


@pytest.mark.parametrize("count", [1, 7, FRAMES, 100])
def test_of_the_first_frames_there_are_as_many_as_asked_for_and_had(count: int) -> None:
    frames = degraded(first(count))
    assert times(frames) == times(list(Grey()))[:count]
    assert DegradedSequence(Grey(), first(count)).frame_count == len(frames)


def test_degradations_on_top_of_each_other_count_from_what_is_left() -> None:
    sequence = DegradedSequence(DegradedSequence(Grey(), first(20)), no_color(1.0))
    assert [i for i, frame in enumerate(sequence) if not frame.color.any()] == list(range(10, 20))


@pytest.mark.parametrize("step", [2, 3, 5])
def test_of_every_nth_frame_the_first_is_there_and_those_a_step_apart(step: int) -> None:
    frames = degraded(every(step))
    assert times(frames) == times(list(Grey()))[::step]
    assert DegradedSequence(Grey(), every(step)).frame_count == len(frames)


def test_about_the_share_of_frames_is_dropped_and_never_the_first() -> None:
    frames = degraded(dropped(0.5))
    assert 20 < len(frames) < 40
    assert frames[0].stamp_ns == 0
    assert set(times(frames)) < set(times(list(Grey())))


def test_holes_take_their_share_of_every_depth_image_and_are_elsewhere_in_the_next() -> None:
    first, second, *_ = (np.isnan(frame.depth) for frame in degraded(depth_holes(0.5)))
    assert first.mean() == second.mean() == pytest.approx(0.5, abs=1e-3)
    assert 0.3 < (first ^ second).mean() < 0.7


def test_holes_are_blobs_and_not_single_pixels() -> None:
    hole = np.isnan(degraded(depth_holes(0.5))[0].depth)
    assert (hole[:, 1:] == hole[:, :-1]).mean() > 0.95


def test_depth_outside_holes_is_as_it_was() -> None:
    depth = degraded(depth_holes(0.5))[0].depth
    assert set(np.unique(depth[np.isfinite(depth)])) == {np.float32(2.0)}


def test_a_dim_wall_has_a_part_of_its_brightness_and_the_noise_of_a_camera() -> None:
    for frame in degraded(dim(0.1)):
        levels = frame.color.astype(np.float64)
        assert levels.mean() == pytest.approx(12.8, abs=0.1)
        assert levels.std() == pytest.approx(2.0, rel=0.05)
        assert (frame.depth == 2.0).all()


def test_colour_is_black_for_a_second_from_the_middle_on() -> None:
    black = [frame for frame in degraded(no_color(1.0)) if not frame.color.any()]
    assert times(black) == pytest.approx(np.arange(3.0, 4.0, 0.1))
    assert all(np.isfinite(frame.depth).all() for frame in black)


def test_depth_is_unknown_for_a_second_from_the_middle_on() -> None:
    blind = [frame for frame in degraded(no_depth(1.0)) if np.isnan(frame.depth).all()]
    assert times(blind) == pytest.approx(np.arange(3.0, 4.0, 0.1))
    assert all((frame.color == 128).all() for frame in blind)


def test_somebody_walks_from_left_to_right_and_back() -> None:
    before = [frame.depth < 1.9 for frame in degraded(somebody_walks_by(PasserBy(period=4.0)))]
    columns = [np.flatnonzero(person.any(axis=0)) for person in before]
    middle = [c.mean() if len(c) else np.nan for c in columns]
    assert np.isnan([middle[0], middle[20], middle[40]]).all()  # outside at each end
    assert middle[10] == pytest.approx(79.5, abs=1.0)
    assert middle[9] < middle[10] < middle[11]
    assert middle[29] > middle[30] > middle[31]
    assert len(columns[10]) == pytest.approx(100 * 2 * 0.28 / 1.5, rel=0.05)


def test_somebody_is_a_round_body_before_the_wall_and_cut_off_above() -> None:
    frame = degraded(somebody_walks_by(PasserBy(period=4.0, tall=0.3)))[10]
    assert np.nanmin(frame.depth) == pytest.approx(1.5 - 0.28, abs=1e-3)
    assert frame.depth[60, 80] < frame.depth[60, 70] < 1.5
    assert (frame.depth[:20] == 2.0).all()
    np.testing.assert_array_equal(
        (frame.color != 128).any(axis=2) | (frame.depth < 2.0), frame.depth < 2.0
    )
    assert frame.color[frame.depth < 1.9].std() > 30


def test_somebody_behind_the_wall_is_not_seen() -> None:
    for frame in degraded(somebody_walks_by(PasserBy(distance=3.0))):
        assert (frame.depth == 2.0).all()
        assert (frame.color == 128).all()


def test_what_is_unknown_is_taken_to_be_behind_somebody() -> None:
    frame = replace(next(iter(Grey())), depth=np.full((120, 160), np.nan, np.float32))
    crossed = PasserBy(period=4.0).before(replace(frame, stamp_ns=NANOSECONDS), 0)
    assert 0.1 < np.isfinite(crossed.depth).mean() < 0.5


def test_a_grey_image_stays_one() -> None:
    frame = next(iter(Grey()))
    crossed = PasserBy(period=4.0).before(
        replace(frame, color=frame.color[..., 0], stamp_ns=NANOSECONDS), 0
    )
    assert crossed.color.shape == (120, 160)
    assert crossed.color.dtype == np.uint8


@pytest.mark.parametrize("degradation", DEGRADATIONS, ids=lambda d: d.name)
def test_a_degraded_sequence_gives_the_same_frames_each_time(degradation: Degradation) -> None:
    sequence = DegradedSequence(Grey(), degradation)
    for a, b in zip(sequence, sequence, strict=True):
        assert a.stamp_ns == b.stamp_ns
        np.testing.assert_array_equal(a.color, b.color)
        np.testing.assert_array_equal(a.depth, b.depth)


def test_a_degraded_sequence_is_one_that_has_the_truth_of_the_original_and_closes_it() -> None:
    original = Grey()
    with DegradedSequence(original, every(3)) as opened:
        sequence: Recording = opened
        assert sequence.name == "grey, every 3rd frame"
        assert sequence.ground_truth is original.ground_truth
        assert len(list(sequence)) <= sequence.frame_count
    assert original.closed
