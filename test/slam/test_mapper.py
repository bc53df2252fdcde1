"""Loops are closed where a camera comes back, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.drifted import config, drifted, rmse
from rigs.hamming_votes import HammingVotes

from rgbd_glue_ros.evaluation.graph_errors import edge_errors
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam.loop_closure import loop_edge
from rgbd_glue_ros.slam.loop_finder import LoopFinder
from rgbd_glue_ros.slam.mapper import Mapper
from rgbd_glue_ros.types import EdgeOrigin, Float64, Trajectory


def mapped_with_drift() -> Mapper:
    """A mapper fed with keyframes and edges that have drifted."""
    mapper = Mapper(LoopFinder(config(), Glue(config()), HammingVotes))
    for known in drifted():
        mapper.add_edges(known.edges)
        mapper.add(replace(known.keyframe, T_odom_camera=known.T_odom_camera))
    return mapper


def true() -> Float64:
    return np.array([known.T_true for known in drifted()])


@pytest.mark.slow
def test_injected_drift_is_taken_out_where_the_camera_comes_back() -> None:
    pytest.importorskip("gtsam", reason="GTSAM is not installed")
    mapper = mapped_with_drift()
    truth = true()
    before = rmse(mapper.graph.keyframes.poses, truth)
    optimum = mapper.finish()
    after = rmse(optimum.graph.keyframes.poses, truth)
    assert before > 0.04
    assert after < 0.25 * before
    assert (optimum.weights == 1.0).all()


def test_loops_agree_with_the_truth_as_far_as_their_covariance_says() -> None:
    mapper = mapped_with_drift()
    loops = tuple(edge for edge in mapper.edges if edge.origin is EdgeOrigin.LOOP)
    assert len(loops) >= 3
    truth = true()
    for loop in loops:
        T_true = se3.inverse(truth[loop.parent]) @ truth[loop.child]
        assert se3.difference(loop.T_parent_child, T_true) < 0.01
    stamps = mapper.graph.keyframes.stamps_ns
    graph = replace(mapper.graph, edges=loops)
    errors = edge_errors(graph, _dense(Trajectory(stamps, truth)))
    assert errors[EdgeOrigin.LOOP].chi2_per_dof < 2.0


def test_a_revisit_between_keyframes_of_a_loop_is_not_counted_a_second_time() -> None:
    mapper = mapped_with_drift()
    before = list(mapper.edges)
    loop = next(edge for edge in before if edge.origin is EdgeOrigin.LOOP)
    again = replace(loop, origin=EdgeOrigin.REVISIT)
    linked = {(edge.parent, edge.child) for edge in before}
    parent = next(n for n in range(loop.child) if (n, loop.child) not in linked)
    other = replace(again, parent=parent)
    mapper.add_edges((again, other))
    assert mapper.edges == [*before, other]


def _dense(truth: Trajectory) -> Trajectory:
    """The truth with each pose twice, a microsecond apart, so that none is interpolated afar."""
    stamps = np.column_stack([truth.stamps_ns - 1000, truth.stamps_ns + 1000]).ravel()
    return Trajectory(stamps, np.repeat(truth.poses, 2, axis=0))


def test_the_same_images_with_another_geometry_are_no_loop() -> None:
    """A picture of a room is not the room."""
    keyframes = [known.keyframe for known in drifted()]
    glue = Glue(config())
    here, there = keyframes[0], keyframes[-1]
    assert loop_edge(here, there, glue, config()) is not None
    view = there.features.view
    flat = replace(view, depth=np.full_like(view.depth, 2.0))
    picture = replace(there, features=glue.extract(flat))
    assert loop_edge(here, picture, glue, config()) is None


def test_the_same_geometry_with_other_images_is_no_loop() -> None:
    keyframes = [known.keyframe for known in drifted()]
    glue = Glue(config())
    here, there = keyframes[0], keyframes[-1]
    view = there.features.view
    noise = np.random.default_rng(0).integers(0, 256, view.grey.shape, np.uint8)
    repainted = replace(there, features=glue.extract(replace(view, grey=noise)))
    assert loop_edge(here, repainted, glue, config()) is None


def test_without_a_loop_poses_stay_where_the_odometry_has_them() -> None:
    pytest.importorskip("gtsam", reason="GTSAM is not installed")
    mapper = Mapper(LoopFinder(config(), Glue(config()), HammingVotes))
    for known in drifted()[:2]:
        mapper.add_edges(known.edges)
        mapper.add(replace(known.keyframe, T_odom_camera=known.T_odom_camera))
    optimum = mapper.finish()
    np.testing.assert_array_equal(optimum.graph.keyframes.poses, mapper.graph.keyframes.poses)
