"""Images that come again: they are as old as the first of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.bag_frames import errors, recorded_frames, true_poses

from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.odometry.repeated_images import SOON_NS, LastDepth, show_the_same
from rgbd_glue_ros.parameters import CameraConfig, Config, with_values
from rgbd_glue_ros.types import Float64, RgbdFrame, View

MOVING = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])


def moving_view(frame: RgbdFrame, twist: Float64 = MOVING) -> View:
    return replace(view_of(frame, CameraConfig()), twist=twist)


def test_depth_that_comes_again_is_as_old_as_the_frame_it_came_with_first() -> None:
    first, later = recorded_frames()[:2]
    last = LastDepth.after(None, moving_view(first), 0)
    for stamp_ns in (SOON_NS // 3, SOON_NS):
        view = moving_view(replace(later, depth=first.depth))
        last = LastDepth.after(last, view, stamp_ns)
        assert last.dated(view, stamp_ns).depth_delay == pytest.approx(-stamp_ns / 1e9)


def test_depth_that_differs_in_one_pixel_is_new() -> None:
    first, later = recorded_frames()[:2]
    last = LastDepth.after(None, moving_view(first), 0)
    depth = first.depth.copy()
    depth[17, 33] += np.float32(1e-6)
    view = moving_view(replace(later, depth=depth))
    stamp_ns = SOON_NS // 3
    assert LastDepth.after(last, view, stamp_ns).dated(view, stamp_ns).depth_delay == 0.0


@pytest.mark.parametrize("resting", [True, False])
def test_depth_of_a_simulated_camera_at_rest_is_new_in_every_frame(resting: bool) -> None:
    """Or of one that has rested for long, whatever the filter makes of it."""
    frame = recorded_frames()[0]
    stamp_ns = SOON_NS // 3 if resting else SOON_NS + 1
    view = moving_view(frame, np.zeros(6) if resting else MOVING)
    last = LastDepth.after(LastDepth.after(None, view, 0), view, stamp_ns)
    assert last.dated(view, stamp_ns) is view


def test_views_show_the_same_only_if_depth_is_unknown_at_the_same_pixels() -> None:
    frame = recorded_frames()[0]
    view = moving_view(frame)
    assert np.isnan(view.depth).any()
    assert show_the_same(view, replace(view, depth=view.depth.copy()))
    depth = view.depth.copy()
    depth[np.unravel_index(np.nanargmin(depth), depth.shape)] = np.nan
    assert not show_the_same(view, replace(view, depth=depth))


@pytest.mark.slow
@pytest.mark.parametrize("period", [2, 3])
def test_where_a_driver_sends_depth_again_poses_are_nearly_as_good_as_with_new_depth(
    period: int,
) -> None:
    """Taken for new, depth of every third frame makes errors more than ten times as large."""
    frames = recorded_frames()
    # of a camera whose own offsets are known, as estimated they make up for some of it
    config = with_values(Config(), {"time_offsets.spread": 0.0})
    mean = []
    for every in (1, period):
        again = [replace(f, depth=frames[i - i % every].depth) for i, f in enumerate(frames)]
        with Odometry(config) as odometry:
            off, _ = errors([odometry.process(frame) for frame in again], true_poses())
        assert np.isfinite(off).all()
        mean.append(off.mean())
    assert mean[1] < 1.5 * mean[0]
