"""What one frame leaves for the next: when frames are missing, and when it is time to restart."""

from __future__ import annotations

from itertools import accumulate

import pytest

from rgbd_glue_ros.odometry.progress import Progress
from rgbd_glue_ros.types import TrackingState

MILLISECOND_NS = 1_000_000


def after(*intervals_ms: int) -> Progress:
    """The progress after frames at these intervals."""
    progress = Progress()
    for stamp_ms in accumulate(intervals_ms, initial=1000):
        progress = progress.with_frame(stamp_ms * MILLISECOND_NS, None)
    return progress


@pytest.mark.parametrize(
    ("intervals_ms", "is_after_gap"),
    [
        ((33, 33, 700), True),
        ((200, 200, 700), True),
        # of a camera at a frame a second nothing is missing
        ((1000, 1000), False),
        # the motion before is still worth something
        ((33, 33, 133), False),
        ((33, 700, 33), False),
        # what is usual is not known yet
        ((700,), True),
        ((200,), False),
        ((), False),
    ],
)
def test_a_frame_much_later_than_usual_means_that_frames_are_missing(
    intervals_ms: tuple[int, ...], *, is_after_gap: bool
) -> None:
    assert after(*intervals_ms).is_after_gap is is_after_gap


def test_a_frame_without_a_pose_counts_towards_a_restart_only_if_it_showed_enough() -> None:
    dark = Progress().with_miss(shows_enough=False)
    assert (dark.state, dark.frames_missed) == (TrackingState.LOST, 0)
    assert dark.with_miss(shows_enough=True).frames_missed == 1
