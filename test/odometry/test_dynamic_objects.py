"""What moves is taken out of a frame, and nothing of the room is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs.room import room_frame, room_view, true_pose
from rigs.unseen import without_depth

from rgbd_glue_ros.experiments.bench.passer_by import PasserBy
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.dynamic_objects import without_dynamic_objects
from rgbd_glue_ros.odometry.surfaces import Surfaces
from rgbd_glue_ros.types import Float32, RgbdFrame, View

BEFORE, NOW = 0.0, 0.6
# half a swing after they set out they are before the middle of the camera
SOMEBODY = PasserBy(period=4 * NOW)


def view_of(frame: RgbdFrame, like: View) -> View:
    return replace(like, depth=frame.depth)


def crossed(time_s: float, somebody: PasserBy = SOMEBODY) -> View:
    """The room with somebody in it."""
    return view_of(somebody.before(room_frame(time_s), 0), room_view(time_s))


def seen(view: View, time_s: float) -> Surfaces:
    """What a view shows, taken at a time."""
    return Surfaces.seen(view, true_pose(time_s))


def known(depth: Float32) -> float:
    return float(np.isfinite(depth).mean())


@pytest.mark.slow
@settings(deadline=None, max_examples=20)
@given(st.floats(0.0, 3.5), st.floats(0.0, 3.5))
def test_in_a_still_room_nothing_moves(before: float, now: float) -> None:
    now, before = round(now, 1), round(before, 1)
    found = without_dynamic_objects(
        room_view(now), true_pose(now), [seen(room_view(before), before)]
    )
    assert found is None or known(room_view(now).depth) - known(found.depth) < 0.01


def test_a_person_who_appears_is_removed_and_the_room_is_kept() -> None:
    room, view = room_view(NOW), crossed(NOW)
    person = view.depth != room.depth
    assert 0.2 < person.mean() < 0.6
    found = without_dynamic_objects(view, true_pose(NOW), [seen(room_view(BEFORE), BEFORE)])
    assert found is not None
    assert np.isfinite(found.depth[person]).mean() < 0.05
    behind = ~person & np.isfinite(room.depth)
    assert np.isfinite(found.depth[behind]).mean() > 0.9
    np.testing.assert_array_equal(
        found.depth[np.isfinite(found.depth)], view.depth[np.isfinite(found.depth)]
    )
    np.testing.assert_array_equal(found.grey, view.grey)


def test_a_person_who_leaves_does_not_remove_anything_else() -> None:
    assert (
        without_dynamic_objects(room_view(NOW), true_pose(NOW), [seen(crossed(NOW), NOW)]) is None
    )


def test_one_frame_that_saw_the_place_empty_is_enough() -> None:
    view, T = crossed(NOW), true_pose(NOW)
    full, empty = seen(view, NOW), seen(room_view(BEFORE), BEFORE)
    assert without_dynamic_objects(view, T, [full]) is None
    found = without_dynamic_objects(view, T, [full, empty])
    assert found is not None
    assert known(found.depth) < known(crossed(NOW).depth) - 0.2


def test_nothing_appears_where_depth_was_unknown_before() -> None:
    blind = without_depth(room_view(BEFORE))
    assert without_dynamic_objects(crossed(NOW), true_pose(NOW), [seen(blind, BEFORE)]) is None
    assert without_dynamic_objects(crossed(NOW), true_pose(NOW), []) is None


def test_if_everything_seems_to_have_moved_the_pose_is_wrong() -> None:
    room = room_view(NOW)
    twice = replace(room, depth=2 * room.depth)
    assert without_dynamic_objects(room, true_pose(NOW), [seen(twice, NOW)]) is None


@pytest.mark.parametrize("radians", [-0.02, 0.02])
def test_a_pose_error_of_a_few_pixels_removes_little_of_the_room(radians: float) -> None:
    turned = true_pose(NOW) @ se3.exp(np.array([0, 0, 0, radians, radians, 0]))
    found = without_dynamic_objects(room_view(NOW), turned, [seen(room_view(BEFORE), BEFORE)])
    assert found is None or known(room_view(NOW).depth) - known(found.depth) < 0.03


def test_late_depth_is_compared_where_it_was_taken() -> None:
    """A camera that turns by 3 rad/s; depth is 50 ms late in both."""
    delay, twist = 0.05, np.array([0, 0, 0, 0, 3.0, 0])
    back = se3.exp(-delay * twist)
    late = replace(room_view(NOW), twist=twist, depth_delay=delay)
    found = without_dynamic_objects(late, true_pose(NOW) @ back, [seen(room_view(NOW), NOW)])
    assert found is None or known(late.depth) - known(found.depth) < 0.01
