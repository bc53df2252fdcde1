"""A map made keyframe by keyframe ends where the map of all at once does."""

from __future__ import annotations

from collections import defaultdict
from statistics import median
from time import process_time

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames
from rigs.drifted import config, drifted, rmse
from rigs.pose_graphs import random_graph

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.slam.incremental import IncrementalOptimiser
from rgbd_glue_ros.slam.live_map import Keyed, LiveMap
from rgbd_glue_ros.slam.optimiser import optimise
from rgbd_glue_ros.types import PoseGraphEdge

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


@pytest.mark.slow
def test_the_thousandth_keyframe_costs_as_much_as_the_hundredth() -> None:
    graph = random_graph(14, 1000)
    incremental = IncrementalOptimiser()
    edges = by_child(graph.edges)
    seconds = []
    for number, T in enumerate(graph.keyframes.poses):
        incremental.add(number, T)
        for edge in edges[number]:
            incremental.add_edge(edge)
        start = process_time()
        incremental.update()
        seconds.append(process_time() - start)
    # copying all poses grows; solving all again would grow a hundredfold
    assert median(seconds[900:]) < 30 * median(seconds[100:200])


@pytest.mark.slow
def test_injected_drift_is_taken_out_while_the_camera_moves() -> None:
    pytest.importorskip("pyhbst", reason="pyHBST is not installed")
    keyframes = drifted()
    live = LiveMap(config())
    for number, keyframe in enumerate(keyframes):
        frame = recorded_frames()[keyframe.row]
        live.add(number, Keyed(frame, keyframe.T_odom_camera, keyframe.edges))
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
