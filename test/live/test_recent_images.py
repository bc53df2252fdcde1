"""Images are kept while they may be of a keyframe, whatever the camera's rate."""

from __future__ import annotations

import pytest

from rgbd_glue_ros.live.recent_images import RecentImages
from rgbd_glue_ros.types import NANOSECONDS

LAG_NS = NANOSECONDS // 5


@pytest.mark.parametrize("hertz", [15, 30, 90])
def test_images_are_kept_for_a_second_after_the_pose_of_their_frame(hertz: int) -> None:
    images: RecentImages[int] = RecentImages(tuple)
    stamps = [i * NANOSECONDS // hertz for i in range(10 * hertz)]
    for stamp in stamps:
        images.add(stamp, stamp)
        images.track(stamp - LAG_NS)
    newest = stamps[-1] - LAG_NS
    kept = [stamp for stamp in stamps if images.at(stamp) is not None]
    assert kept == [stamp for stamp in stamps if stamp >= newest - NANOSECONDS]
    assert len(images) == len(kept)


def test_without_poses_two_seconds_are_kept() -> None:
    images: RecentImages[int] = RecentImages(tuple)
    for stamp in range(0, 60 * NANOSECONDS, NANOSECONDS // 10):
        images.add(stamp, stamp)
    assert len(images) == 21


def test_what_is_needed_is_kept_however_old() -> None:
    needed: list[int] = [0]
    images: RecentImages[int] = RecentImages(lambda: needed)
    for stamp in range(0, 60 * NANOSECONDS, NANOSECONDS // 10):
        images.add(stamp, stamp)
        images.track(stamp)
    assert images.at(0) == 0
    needed.clear()
    images.track(60 * NANOSECONDS)
    assert images.at(0) is None


def test_when_time_goes_back_images_from_before_are_dropped_and_those_after_it_kept() -> None:
    images: RecentImages[int] = RecentImages(tuple)
    for stamp in (100, 101, 102):
        images.add(stamp * NANOSECONDS, stamp)
    images.track(102 * NANOSECONDS)
    images.add(0, 0)
    # the pose of the last frame before the jump comes late
    images.track(102 * NANOSECONDS)
    assert (len(images), images.at(0)) == (1, 0)
    assert images.may_come(1)
    assert not images.may_come(-1)
