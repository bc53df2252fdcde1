"""A map made keyframe by keyframe ends where the map of all at once does."""

from __future__ import annotations

from collections import defaultdict
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames
from rigs.drifted import config, drifted, rmse
from rigs.pose_graphs import random_graph
from rigs.sight import Sight

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.slam import loop_finder
from rgbd_glue_ros.slam.edge_composition import composed
from rgbd_glue_ros.slam.incremental import IncrementalOptimiser
from rgbd_glue_ros.slam.live_map import LiveMap, PublishedKeyframe
from rgbd_glue_ros.slam.map_file import SavedMap
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.slam.optimiser import optimise
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraphEdge

pytest.importorskip("gtsam", reason="GTSAM is not installed")


def by_child(edges: tuple[PoseGraphEdge, ...]) -> dict[int, list[PoseGraphEdge]]:
    found = defaultdict(list)
    for edge in edges:
        found[edge.child].append(edge)
    return found


def test_keyframe_by_keyframe_the_optimum_is_that_of_all_at_once() -> None:
    # residuals so small that doubt takes no weight from them
    graph = random_graph(13, 60, 0.1)
    incremental = IncrementalOptimiser()
    edges = by_child(graph.edges)
    for number, T in enumerate(graph.keyframes.poses):
        incremental.add(number, T)
        for edge in edges[number]:
            incremental.add_edge(edge)
        poses = incremental.update()
    expected = optimise(graph).graph.keyframes.poses
    assert len(poses) == 60
    apart = [se3.difference(poses[i], expected[i]) for i in range(60)]
    assert max(apart) < 2e-3


class Counting:
    """An iSAM2 that counts the keyframes that each update solves for and linearises again."""

    def __init__(self, isam: Any) -> None:
        self._isam = isam
        self.solved: list[int] = []
        self.linearised: list[int] = []

    def update(self, *graph: Any) -> None:
        result = self._isam.update(*graph)
        self.solved.append(result.getVariablesReeliminated())
        self.linearised.append(result.getVariablesRelinearized())

    def calculateEstimate(self) -> Any:
        return self._isam.calculateEstimate()


@pytest.mark.slow
def test_an_update_solves_for_the_latest_keyframes_alone_however_many_there_are() -> None:
    graph = random_graph(14, 1000)
    incremental = IncrementalOptimiser()
    counting = incremental._isam = Counting(incremental._isam)
    edges = by_child(graph.edges)
    for number, T in enumerate(graph.keyframes.poses):
        incremental.add(number, T)
        for edge in edges[number]:
            incremental.add_edge(edge)
        incremental.update()
    assert incremental._isam is counting
    for counts in (counting.solved, counting.linearised):
        assert len(counts) == 1000
        assert 0 < max(counts[900:]) < 100


@pytest.mark.slow
def test_injected_drift_is_taken_out_while_the_camera_moves() -> None:
    pytest.importorskip("pyhbst", reason="pyHBST is not installed")
    keyframes = drifted()
    live = LiveMap(config())
    for number, keyframe in enumerate(keyframes):
        frame = recorded_frames()[keyframe.row]
        live.add(number, PublishedKeyframe(frame, keyframe.T_odom_camera, keyframe.edges))
    truth = np.array([keyframe.T_true for keyframe in keyframes])
    before = rmse(np.array([keyframe.T_odom_camera for keyframe in keyframes]), truth)
    after = rmse(np.array([live.poses[row] for row in range(len(keyframes))]), truth)
    assert before > 0.04
    assert live.loops >= 3
    assert after < 0.25 * before
    assert live.T_map_odom is not None
    np.testing.assert_allclose(
        live.T_map_odom @ keyframes[-1].T_odom_camera, live.poses[len(keyframes) - 1], atol=1e-9
    )


def test_an_update_that_fails_costs_what_was_added_and_nothing_before_or_after() -> None:
    graph = random_graph(15, 12, 0.1)
    failing, untouched = IncrementalOptimiser(), IncrementalOptimiser()
    edges = by_child(graph.edges)
    for number, T in enumerate(graph.keyframes.poses):
        for optimiser in (failing, untouched):
            optimiser.add(number, T)
            for edge in edges[number]:
                optimiser.add_edge(edge)
            poses = optimiser.update()
        # a keyframe without an edge, an edge without a keyframe, and one that says nothing
        failing.add(number + 1, T)
        with pytest.raises(InputError, match="the pose graph: has no optimum") as refused:
            failing.update()
        assert "no edge links" in str(refused.value)
        for parent, covariance in ((99, np.eye(6)), (0, np.full((6, 6), np.nan))):
            failing.add_edge(PoseGraphEdge(parent, number, T, covariance))
            with pytest.raises(InputError, match="the pose graph: has no optimum") as refused:
                failing.update()
            assert "\n" not in str(refused.value)
    apart = [se3.difference(failing.update()[i], poses[i]) for i in range(12)]
    # it linearises anew, and what is nearer than its threshold is not linearised again
    assert max(apart) < 1e-4


def keyed(number: int) -> PublishedKeyframe:
    known = drifted()[number]
    return PublishedKeyframe(recorded_frames()[known.row], known.T_odom_camera, known.edges)


def edges_to(saved: SavedMap, child: int) -> list[PoseGraphEdge]:
    """What the odometry says of a row."""
    found = [edge for edge in saved.graph.edges if edge.child == child]
    return [edge for edge in found if edge.origin is not EdgeOrigin.LOOP]


def test_edges_lead_over_keyframes_without_images() -> None:
    pytest.importorskip("pyhbst", reason="pyHBST is not installed")
    chain = [drifted()[number].edges[0] for number in range(1, 4)]
    assert [edge.parent for edge in chain] == [0, 1, 2]
    live = LiveMap(config())
    live.add(0, keyed(0))
    for number in (1, 2):
        live.skip(number, drifted()[number].edges)
    live.add(3, keyed(3))
    saved = live.saved()
    assert len(saved) == 2
    (found,) = edges_to(saved, 1)
    expected = composed(composed(chain[0], chain[1]), chain[2])
    assert (found.parent, found.origin) == (0, EdgeOrigin.TRACKING)
    np.testing.assert_allclose(found.T_parent_child, expected.T_parent_child, atol=1e-12)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-9)


def test_a_later_edge_moves_odom_with_the_newest_keyframe() -> None:
    pytest.importorskip("pyhbst", reason="pyHBST is not installed")
    live_map = LiveMap(config())
    for number in range(3):
        live_map.add(number, keyed(number))
    before = live_map.T_map_odom
    assert before is not None
    first, _, newest = (keyframe.T_odom_camera for keyframe in drifted()[:3])
    T = se3.inverse(first) @ newest @ se3.exp(np.array([0.02, 0, 0, 0, 0, 0]))
    live_map.add_edge(PoseGraphEdge(0, 2, T, 1e-8 * np.eye(6), EdgeOrigin.REVISIT))
    after = live_map.T_map_odom
    assert after is not None
    assert se3.difference(before, after) > 0.01
    np.testing.assert_allclose(after @ newest, live_map.poses[2], atol=1e-12)


def test_a_keyframe_without_a_known_edge_is_assumed_where_the_odometry_has_it() -> None:
    pytest.importorskip("pyhbst", reason="pyHBST is not installed")
    live = LiveMap(config())
    for number in (0, 2, 3):
        live.add(number, keyed(number))
    saved = live.saved()
    assert len(saved) == 3
    (assumed,) = edges_to(saved, 1)
    assert (assumed.parent, assumed.origin) == (0, EdgeOrigin.ASSUMED)
    first, second = keyed(0), keyed(2)
    T = se3.inverse(first.T_odom_camera) @ second.T_odom_camera
    np.testing.assert_allclose(assumed.T_parent_child, T, atol=1e-12)
    seconds = (second.frame.stamp_ns - first.frame.stamp_ns) / 1e9
    # a metre for each second, all ways
    sigmas = np.sqrt(np.linalg.eigvalsh(assumed.covariance[:3, :3]))
    np.testing.assert_allclose(sigmas, seconds, rtol=0.05)
    (measured,) = edges_to(saved, 2)
    assert (measured.parent, measured.origin) == (1, EdgeOrigin.TRACKING)


def test_a_keyframe_with_which_there_is_no_optimum_is_left_out_and_the_map_goes_on() -> None:
    pytest.importorskip("pyhbst", reason="pyHBST is not installed")
    live = LiveMap(config())
    live.add(0, keyed(0))
    bad = keyed(1)
    nothing = tuple(replace(edge, covariance=np.full((6, 6), np.nan)) for edge in bad.edges)
    with pytest.raises(InputError, match="the pose graph: has no optimum"):
        live.add(1, replace(bad, edges=nothing))
    assert len(live.saved()) == 1
    for number in (2, 3):
        live.add(number, keyed(number))
    with pytest.raises(InputError, match="the pose graph: has no optimum"):
        live.add_edge(PoseGraphEdge(2, 3, np.eye(4), np.full((6, 6), np.nan)))
    saved = live.saved()
    assert [len(edges_to(saved, row)) for row in range(3)] == [0, 1, 1]
    np.testing.assert_allclose(saved.graph.keyframes.poses[0], np.eye(4), atol=1e-3)
    assert np.isfinite(saved.graph.keyframes.poses).all()
    assert sorted(live.poses) == sorted(live.stamps_ns()) == [0, 1, 2]


def test_loops_with_which_there_is_no_optimum_cost_no_keyframe(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("pyhbst", reason="pyHBST is not installed")
    tried: list[tuple[int, int]] = []

    def useless(parent: MapKeyframe, child: MapKeyframe, *_: object) -> PoseGraphEdge:
        tried.append((parent.row, child.row))
        covariance = np.full((6, 6), np.nan)
        return PoseGraphEdge(*tried[-1], np.eye(4), covariance, EdgeOrigin.LOOP)

    monkeypatch.setattr(loop_finder, "loop_edge", useless)
    live = LiveMap(config())
    for number in range(5):
        with suppress(InputError):
            live.add(number, keyed(number))
    assert {child for _, child in tried} >= {3, 4}
    assert live.loops == 0
    saved = live.saved()
    assert [edge for edge in saved.graph.edges if edge.origin is EdgeOrigin.LOOP] == []
    expected = np.array([keyed(number).T_odom_camera for number in range(5)])
    np.testing.assert_allclose(saved.graph.keyframes.poses, expected, atol=1e-3)
    assert live.T_map_odom is not None
    np.testing.assert_allclose(live.T_map_odom, np.eye(4), atol=1e-3)


def map_of_three() -> SavedMap:
    """A map as it is saved after the first three keyframes."""
    pytest.importorskip("pyhbst", reason="pyHBST is not installed")
    before = LiveMap(config())
    for number in range(3):
        before.add(number, keyed(number))
    return before.saved()


def loops_of(saved: SavedMap) -> list[PoseGraphEdge]:
    return [edge for edge in saved.graph.edges if edge.origin is EdgeOrigin.LOOP]


def test_where_the_search_for_one_of_several_fails_loops_of_the_others_are_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = map_of_three()
    sight = Sight(monkeypatch)
    live = LiveMap(config(), before)
    for number in (0, 1):
        live.add(number, replace(keyed(number), edges=()))
    sight.is_blind, sight.failing = False, {4}
    with pytest.raises(ArithmeticError):
        live.add(2, replace(keyed(2), edges=()))
    saved = live.saved()
    assert len(saved) == 6
    found = loops_of(saved)[len(loops_of(before)) :]
    assert {edge.child for edge in found} == {3, 5}
    assert live.loops == len(found)
    # those that could not be compared can be compared with, and so can those after them
    live.add(3, keyed(3))
    assert {edge.child for edge in loops_of(live.saved())} >= {3, 5, 6}


def test_a_revisit_between_keyframes_of_a_loop_is_not_counted_a_second_time() -> None:
    pytest.importorskip("pyhbst", reason="pyHBST is not installed")
    live = LiveMap(config(), map_of_three())
    # the second session's keyframes are rows 3, 4, 5 and 6
    for number in range(4):
        live.add(number, keyed(number))
    before = live.saved()
    own = [edge for edge in loops_of(before) if edge.parent >= 3]
    assert own
    loop = own[0]
    again = replace(loop, parent=loop.parent - 3, child=loop.child - 3, origin=EdgeOrigin.REVISIT)
    live.add_edge(again)
    assert len(live.saved().graph.edges) == len(before.graph.edges)


def test_a_given_map_is_restored_once_however_often_the_odometry_starts_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = map_of_three()
    restored: list[int] = []
    restore = loop_finder.LoopFinder.restore

    def counted(self: loop_finder.LoopFinder, saved: SavedMap, *progress: Any) -> None:
        restored.append(len(saved))
        restore(self, saved, *progress)

    monkeypatch.setattr(loop_finder.LoopFinder, "restore", counted)
    live = LiveMap(config(), before)
    restored_poses = live.saved().graph.keyframes.poses
    placed = [live.is_placed]
    # the first graph begins
    live.clear()
    assert restored == [3]
    assert live.locate(keyed(1))
    placed.append(live.is_placed)
    # the odometry starts anew: where its frame is in the map is not known, but the map is as it was
    live.clear()
    assert restored == [3]
    placed.append(live.is_placed)
    live.add(0, replace(keyed(1), edges=()))
    placed.append(live.is_placed)
    assert placed == [False, True, False, True]
    assert len(live.saved()) == 4
    live.clear()
    assert restored == [3]
    assert live.loops == 0
    placed = [live.is_placed]
    after = live.saved()
    assert len(after) == 3
    np.testing.assert_array_equal(after.graph.keyframes.poses, restored_poses)
    # what was of the session before is no candidate of the next
    live.add(0, replace(keyed(2), edges=()))
    placed.append(live.is_placed)
    assert placed == [False, True]
    assert all(edge.parent < 3 for edge in loops_of(live.saved()))


def test_while_the_odometry_starts_anew_the_pose_of_odom_in_a_given_map_is_unknown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = map_of_three()
    live = LiveMap(config(), before)
    live.add(0, replace(keyed(1), edges=()))
    assert live.is_placed
    # another thread may broadcast the pose meanwhile
    during: list[bool] = []
    update = IncrementalOptimiser.update

    def watched(self: IncrementalOptimiser) -> dict[int, Float64]:
        during.append(live.is_placed)
        poses = update(self)
        during.append(live.is_placed)
        return poses

    monkeypatch.setattr(IncrementalOptimiser, "update", watched)
    live.clear()
    assert during == [False, False]
    assert not live.is_placed
