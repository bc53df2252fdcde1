"""Keyframes are whole whatever the order in which poses and edges come."""

from __future__ import annotations

import numpy as np
import pytest

from rgbd_glue_ros.slam.keyframe_stream import MOST_WAITING, KeyframeStream, NewKeyframe
from rgbd_glue_ros.slam.optimiser import TRUSTED
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraphEdge


def pose(x: float) -> Float64:
    T = np.eye(4)
    T[0, 3] = x
    return T


def edge(parent: int, child: int) -> PoseGraphEdge:
    return PoseGraphEdge(parent, child, pose(child - parent), np.eye(6))


def said(keyframes: list[NewKeyframe]) -> list[tuple[int, int, float, bool, bool]]:
    return [
        (k.number, k.stamp_ns, float(k.T_odom_child[0, 3]), k.edge is not None, k.is_anew)
        for k in keyframes
    ]


@pytest.mark.parametrize("edge_comes_first", [False, True])
def test_the_first_edge_makes_two_keyframes_and_each_further_one(edge_comes_first: bool) -> None:
    stream = KeyframeStream()
    assert stream.add_pose(100, pose(0)) == []
    found: list[NewKeyframe] = []
    for number, stamp in ((1, 200), (2, 300)):
        if edge_comes_first:
            assert stream.add_edge(stamp, edge(number - 1, number)) == ([], None)
            found += stream.add_pose(stamp, pose(number))
        else:
            assert stream.add_pose(stamp, pose(number)) == []
            keyframes, late = stream.add_edge(stamp, edge(number - 1, number))
            assert late is None
            found += keyframes
    assert said(found) == [
        (0, 100, 0.0, False, True),
        (1, 200, 1.0, True, False),
        (2, 300, 2.0, True, False),
    ]


def test_an_edge_to_an_anchor_comes_by_itself_as_a_revisit() -> None:
    stream = KeyframeStream()
    for number, stamp in ((0, 100), (1, 200), (2, 300)):
        stream.add_pose(stamp, pose(number))
        if number:
            keyframes, _ = stream.add_edge(stamp, edge(number - 1, number))
            assert keyframes[-1].edge is not None
            assert keyframes[-1].edge.origin is EdgeOrigin.TRACKING
    late = edge(0, 2)
    keyframes, revisit = stream.add_edge(300, late)
    assert keyframes == []
    assert revisit is not None
    assert (revisit.parent, revisit.child) == (0, 2)
    assert revisit.T_parent_child is late.T_parent_child
    # the map doubts it, since two places may be alike
    assert revisit.origin is EdgeOrigin.REVISIT
    assert revisit.origin not in TRUSTED


def test_a_revisit_that_comes_before_the_pose_is_not_taken_for_the_edge_of_tracking() -> None:
    stream = KeyframeStream()
    stream.add_pose(100, pose(0))
    stream.add_pose(200, pose(1))
    stream.add_edge(200, edge(0, 1))
    tracked, revisit = edge(1, 2), edge(0, 2)
    for early in (tracked, revisit):
        assert stream.add_edge(300, early) == ([], None)
    (keyframe,) = stream.add_pose(300, pose(2))
    assert keyframe.edge is tracked


def test_after_a_reset_a_new_graph_begins() -> None:
    stream = KeyframeStream()
    stream.add_pose(100, pose(0))
    stream.add_pose(200, pose(1))
    stream.add_edge(200, edge(0, 1))
    stream.add_pose(1000, pose(0))
    stream.add_pose(1100, pose(1))
    keyframes, _ = stream.add_edge(1100, edge(0, 1))
    assert said(keyframes) == [(0, 1000, 0.0, False, True), (1, 1100, 1.0, True, False)]


@pytest.mark.parametrize("pose_comes_first", [False, True])
@pytest.mark.parametrize("stamp", [1000, 50])
def test_the_first_keyframe_is_whole_as_soon_as_a_graph_is_said_to_begin(
    stamp: int, pose_comes_first: bool
) -> None:
    stream = KeyframeStream()
    assert stream.begin(100) == []
    assert said(stream.add_pose(100, pose(0))) == [(0, 100, 0.0, False, False)]
    stream.add_pose(200, pose(1))
    assert said(stream.add_edge(200, edge(0, 1))[0]) == [(1, 200, 1.0, True, False)]
    # of these messages the rest was lost
    stream.add_pose(300, pose(2))
    stream.add_edge(250, edge(1, 2))
    # later, or where time went back
    if pose_comes_first:
        assert stream.add_pose(stamp, pose(5)) == []
        found = stream.begin(stamp)
    else:
        assert stream.begin(stamp) == []
        found = stream.add_pose(stamp, pose(5))
    assert said(found) == [(0, stamp, 5.0, False, False)]
    assert stream.waiting == 0
    stream.add_pose(stamp + 100, pose(6))
    keyframes, late = stream.add_edge(stamp + 100, edge(0, 1))
    assert late is None
    assert said(keyframes) == [(1, stamp + 100, 6.0, True, False)]
    assert stream.waiting == 0


def test_a_graph_whose_first_pose_is_lost_begins_once() -> None:
    stream = KeyframeStream()
    stream.begin(100)
    stream.add_pose(200, pose(1))
    assert said(stream.add_edge(200, edge(0, 1))[0]) == [(1, 200, 1.0, True, False)]


def late_comer() -> KeyframeStream:
    """A stream that has seen the keyframes 50 to 53 alone."""
    stream = KeyframeStream()
    for number in range(50, 54):
        stream.add_pose(10 * number, pose(number))
        stream.add_edge(10 * number, edge(number - 1, number))
    return stream


def test_a_reset_begins_a_new_graph_for_who_came_late_and_never_saw_its_numbers() -> None:
    stream = late_comer()
    stream.add_pose(1000, pose(0))
    stream.add_pose(1100, pose(1))
    keyframes, _ = stream.add_edge(1100, edge(0, 1))
    assert said(keyframes) == [(0, 1000, 0.0, False, True), (1, 1100, 1.0, True, False)]
    stream.add_pose(1200, pose(2))
    keyframes, _ = stream.add_edge(1200, edge(1, 2))
    assert said(keyframes) == [(2, 1200, 2.0, True, False)]


def test_a_keyframe_whose_edge_comes_late_begins_no_new_graph() -> None:
    stream = late_comer()
    for number in (54, 55):
        stream.add_pose(10 * number, pose(number))
    assert said(stream.add_edge(550, edge(54, 55))[0]) == [(55, 550, 55.0, True, False)]
    # such as the edge to an anchor, where that of tracking was lost
    keyframes, late = stream.add_edge(540, edge(51, 54))
    assert late is None
    assert said(keyframes) == [(54, 540, 54.0, True, False)]
    stream.add_pose(560, pose(56))
    assert said(stream.add_edge(560, edge(55, 56))[0]) == [(56, 560, 56.0, True, False)]


def test_a_keyframe_of_the_graph_before_that_comes_late_is_left_out() -> None:
    stream = late_comer()
    stream.add_pose(540, pose(54))
    stream.add_pose(1000, pose(0))
    stream.add_pose(1100, pose(1))
    stream.add_edge(1100, edge(0, 1))
    assert stream.add_edge(540, edge(53, 54)) == ([], None)
    assert stream.waiting == 0
    stream.add_pose(1200, pose(2))
    assert said(stream.add_edge(1200, edge(1, 2))[0]) == [(2, 1200, 2.0, True, False)]


def test_keyframes_whose_edges_are_on_the_way_are_awaited() -> None:
    stream = KeyframeStream()
    stream.add_pose(100, pose(0))
    stream.add_pose(200, pose(1))
    # the first of a graph has no edge of its own
    assert list(stream.awaited_ns) == [100, 200]
    stream.add_edge(200, edge(0, 1))
    assert list(stream.awaited_ns) == []
    for stamp in (300, 400, 500):
        stream.add_pose(stamp, pose(2))
    assert list(stream.awaited_ns) == [400, 500]


def test_a_bag_that_begins_anew_begins_a_new_graph_by_the_same_numbers_and_stamps() -> None:
    stream = KeyframeStream()
    for _ in range(2):
        stream.add_pose(100, pose(0))
        stream.add_pose(200, pose(1))
        keyframes, late = stream.add_edge(200, edge(0, 1))
        assert late is None
        assert said(keyframes) == [(0, 100, 0.0, False, True), (1, 200, 1.0, True, False)]


def test_who_comes_late_begins_with_what_there_is() -> None:
    stream = KeyframeStream()
    stream.add_pose(900, pose(8))
    keyframes, _ = stream.add_edge(900, edge(7, 8))
    assert said(keyframes) == [(8, 900, 8.0, False, True)]


@pytest.mark.parametrize("lost", ["edges", "poses"])
def test_what_waits_for_lost_messages_is_bounded_and_said_once(
    lost: str, caplog: pytest.LogCaptureFixture
) -> None:
    stream = KeyframeStream()
    last = 5 * MOST_WAITING
    for number in range(1, last + 1):
        if lost == "edges":
            assert stream.add_pose(number * 10**9, pose(number)) == []
        else:
            assert stream.add_edge(number * 10**9, edge(number - 1, number)) == ([], None)
        assert stream.waiting <= MOST_WAITING
    missing = {"edges": "keyframe/edges: the edge", "poses": "keyframe/pose: the pose"}[lost]
    (message,) = caplog.messages
    assert message.startswith(f"{missing} of the keyframe at 1.000000000 s did not come")
    # what comes whole is taken as before
    stream.add_pose((last + 1) * 10**9, pose(last + 1))
    keyframes, _ = stream.add_edge((last + 1) * 10**9, edge(last, last + 1))
    assert keyframes[-1].number == last + 1


def test_the_newest_of_what_waits_is_kept() -> None:
    stream = KeyframeStream()
    for number in range(1, 3 * MOST_WAITING):
        stream.add_edge(number, edge(number - 1, number))
    keyframes = stream.add_pose(3 * MOST_WAITING - 1, pose(0))
    assert [k.number for k in keyframes] == [3 * MOST_WAITING - 1]


def test_a_lost_message_now_and_then_is_not_said(caplog: pytest.LogCaptureFixture) -> None:
    stream = KeyframeStream()
    stream.add_pose(0, pose(0))
    for number in range(1, 200):
        stream.add_pose(number, pose(number))
        if number % 10:
            stream.add_edge(number, edge(number - 1, number))
    assert not caplog.messages
