"""A recording that is cut short has the first frames of the whole, and all else of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest
from rigs.pan import Pan

from rgbd_glue_ros.recordings import Recording, imu_of
from rgbd_glue_ros.recordings.first_frames import first_frames
from rgbd_glue_ros.recordings.left_out import LeftOut, left_out_of
from rgbd_glue_ros.recordings.other_truth import with_ground_truth
from rgbd_glue_ros.types import ImuSamples


@pytest.mark.parametrize(("count", "left"), [(1, 1), (3, 3), (5, 5), (9, 5)])
def test_frames_are_the_first_and_no_more_than_there_are(count: int, left: int) -> None:
    pan = Pan(5)
    short = first_frames(pan, count)
    stamps = [frame.stamp_ns for frame in pan]
    for _ in range(2):
        assert [frame.stamp_ns for frame in short] == stamps[:left]
    assert short.frame_count == left
    assert [frame.stamp_ns for frame in short.select([0, 2, 4])] == stamps[:left:2]
    assert short.name == pan.name


def test_without_a_number_it_is_the_recording_itself() -> None:
    pan = Pan(3)
    assert first_frames(pan, None) is pan


def test_a_frame_beyond_the_last_is_never_read() -> None:
    assert len(list(first_frames(Pan(5, breaks_after=3), 3))) == 3


@dataclass(frozen=True)
class InertialPan(Pan):
    imu = ImuSamples.empty()
    left_out = LeftOut(unpaired={"depth": 3})


@pytest.mark.parametrize(
    "derived",
    [
        lambda recording: first_frames(recording, 2),
        lambda recording: with_ground_truth(recording, recording.ground_truth),
    ],
)
def test_samples_of_the_imu_and_the_count_of_what_is_left_out_are_kept(
    derived: Callable[[Recording], Recording],
) -> None:
    pan = InertialPan(3)
    assert imu_of(derived(pan)) is pan.imu
    assert left_out_of(derived(pan)) is pan.left_out
