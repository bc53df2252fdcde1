"""With a given map keyframes wait until a place of it is recognised, and none is lost by it."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames
from rigs.drifted import config, drifted
from rigs.sight import Sight

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.slam import waiting_keyframes
from rgbd_glue_ros.slam.live_map import LiveMap, PublishedKeyframe
from rgbd_glue_ros.slam.map_file import SavedMap
from rgbd_glue_ros.types import EdgeOrigin, PoseGraphEdge

pytest.importorskip("gtsam", reason="GTSAM is not installed")
pytest.importorskip("pyhbst", reason="pyHBST is not installed")

NO_OPTIMUM = "the pose graph: has no optimum"


def keyed(number: int) -> PublishedKeyframe:
    known = drifted()[number]
    return PublishedKeyframe(recorded_frames()[known.row], known.T_odom_camera, known.edges)


@lru_cache(maxsize=1)
def map_of_one() -> SavedMap:
    live = LiveMap(config())
    live.add(0, replace(keyed(0), edges=()))
    return live.saved()


def session_rows(live: LiveMap) -> list[int]:
    """Stamps of what was added to the map of one, by the rows."""
    return [at_ns for row, at_ns in sorted(live.stamps_ns().items()) if row >= 1]


def stamps_of(*numbers: int) -> list[int]:
    return [keyed(number).frame.stamp_ns for number in numbers]


def test_too_many_that_wait_are_bounded_by_leaving_out_the_oldest_with_one_warning(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(waiting_keyframes, "MOST_WAITING", 3)
    sight = Sight(monkeypatch)
    live = LiveMap(config(), replace(map_of_one(), name="room.rgbdmap"))
    for number in range(5):
        live.add(number, keyed(number))
    (message,) = caplog.messages
    assert message.startswith("room.rgbdmap: none of its places was recognised in 3 keyframes")
    sight.is_blind = False
    live.add(5, keyed(5))
    assert live.is_placed
    assert session_rows(live) == stamps_of(3, 4, 5)
    assert sorted(live.poses) == [0, 1, 2, 3]
    assert len(caplog.messages) == 1


def test_a_loop_with_which_there_is_no_optimum_costs_none_of_those_that_wait(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sight = Sight(monkeypatch)
    live = LiveMap(config(), map_of_one())
    live.add(0, keyed(0))
    sight.is_blind, sight.is_useless = False, True
    with pytest.raises(InputError, match=NO_OPTIMUM):
        live.add(1, keyed(1))
    placed = [live.is_placed]
    assert len(live.saved()) == 1
    sight.is_useless = False
    live.add(2, keyed(2))
    placed.append(live.is_placed)
    assert placed == [False, True]
    assert session_rows(live) == stamps_of(0, 1, 2)


def test_a_keyframe_with_which_there_is_no_optimum_does_not_wait(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sight = Sight(monkeypatch)
    live = LiveMap(config(), map_of_one())
    live.add(0, keyed(0))
    nothing = PoseGraphEdge(0, 1, np.eye(4), np.full((6, 6), np.nan))
    with pytest.raises(InputError, match=NO_OPTIMUM):
        live.add(1, replace(keyed(1), edges=(nothing,)))
    with pytest.raises(InputError, match=NO_OPTIMUM):
        live.add_edge(replace(nothing, child=0))
    sight.is_blind = False
    live.add(2, keyed(2))
    assert session_rows(live) == stamps_of(0, 2)


def test_a_later_edge_to_one_that_waits_is_in_the_map(monkeypatch: pytest.MonkeyPatch) -> None:
    sight = Sight(monkeypatch)
    live = LiveMap(config(), map_of_one())
    for number in range(3):
        live.add(number, keyed(number))
    T = np.linalg.inv(keyed(0).T_odom_camera) @ keyed(2).T_odom_camera
    late = PoseGraphEdge(0, 2, T, 1e-4 * np.eye(6), EdgeOrigin.REVISIT)
    live.add_edge(late)
    sight.is_blind = False
    live.add(3, keyed(3))
    found = [edge for edge in live.saved().graph.edges if edge.origin is EdgeOrigin.REVISIT]
    assert [(edge.parent, edge.child) for edge in found] == [(1, 3)]
    np.testing.assert_allclose(found[0].T_parent_child, T, atol=1e-12)
