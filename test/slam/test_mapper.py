"""Loops are closed where a camera comes back, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames, true_poses

from rgbd_glue_ros.evaluation.graph_errors import edge_errors
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config, load_preset, with_values
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam.appearance import HammingVotes
from rgbd_glue_ros.slam.loop_closure import loop_edge
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.slam.mapper import Mapper
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraphEdge, Trajectory


@lru_cache(maxsize=1)
def config() -> Config:
    """Keyframes near each other, and drift left in: what loops are to find."""
    changed = {"keyframe_translation": 0.06, "keyframe_rotation": 0.06, "window": 2}
    changed |= {"drift_radius": 0.0}
    return with_values(load_preset("live"), {f"odometry.{k}": v for k, v in changed.items()})


@lru_cache(maxsize=1)
def tracked() -> tuple[tuple[MapKeyframe, ...], tuple[PoseGraphEdge, ...], Float64]:
    """Keyframes of the recording, what was measured between them, and their true poses."""
    odometry = Odometry(config())
    keyframes: list[MapKeyframe] = []
    edges: list[PoseGraphEdge] = []
    rows: list[int] = []
    for row, frame in enumerate(recorded_frames()):
        estimate = odometry.process(frame)
        edges += estimate.edges
        newest = odometry.newest_keyframe
        if estimate.is_keyframe:
            assert newest is not None
            assert estimate.T_odom_camera is not None
            keyframes.append(MapKeyframe.of(newest, estimate.T_odom_camera))
            rows.append(row)
    return tuple(keyframes), tuple(edges), true_poses()[rows]


def drifting(T: Float64, number: int) -> Float64:
    """A pose with the drift of so many keyframes: 5 mm and 2 mrad each."""
    step = se3.exp(np.array([0.005, 0, 0, 0, 0.002, 0]))
    return np.linalg.matrix_power(step, number) @ T


def mapped_with_drift() -> Mapper:
    """A mapper fed with keyframes and edges that have drifted."""
    mapper = Mapper(config(), HammingVotes())
    keyframes, edges, _ = tracked()
    for keyframe in keyframes:
        T = drifting(keyframe.T_odom_camera, keyframe.number)
        mapper.add(replace(keyframe, T_odom_camera=T), config().refine)
    for edge in edges:
        T_parent, T_child = (
            mapper.keyframes[number].T_odom_camera for number in (edge.parent, edge.child)
        )
        mapper.add_edges((replace(edge, T_parent_child=se3.inverse(T_parent) @ T_child),))
    return mapper


def rmse(poses: Float64, truth: Float64) -> float:
    T = truth[0] @ se3.inverse(poses[0])
    return float(np.sqrt(np.mean(np.sum(((T @ poses) - truth)[:, :3, 3] ** 2, axis=1))))


def test_injected_drift_is_taken_out_where_the_camera_comes_back() -> None:
    pytest.importorskip("gtsam", reason="GTSAM is not installed")
    mapper = mapped_with_drift()
    truth = tracked()[2]
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
    truth = tracked()[2]
    for loop in loops:
        T_true = se3.inverse(truth[loop.parent]) @ truth[loop.child]
        assert se3.difference(loop.T_parent_child, T_true) < 0.01
    stamps = mapper.graph.keyframes.stamps_ns
    graph = replace(mapper.graph, edges=loops)
    errors = edge_errors(graph, _dense(Trajectory(stamps, truth)))
    assert errors[EdgeOrigin.LOOP].chi2_per_dof < 2.0


def _dense(truth: Trajectory) -> Trajectory:
    """The truth with each pose twice, a microsecond apart, so that none is interpolated afar."""
    stamps = np.column_stack([truth.stamps_ns - 1000, truth.stamps_ns + 1000]).ravel()
    return Trajectory(stamps, np.repeat(truth.poses, 2, axis=0))


def test_the_same_images_with_another_geometry_are_no_loop() -> None:
    """A picture of a room is not the room."""
    keyframes, _, _ = tracked()
    glue = Glue(config())
    here, there = keyframes[0], keyframes[-1]
    assert loop_edge(here, there, glue, config()) is not None
    view = there.features.view
    flat = replace(view, depth=np.full_like(view.depth, 2.0))
    picture = replace(there, features=glue.extract(flat))
    assert loop_edge(here, picture, glue, config()) is None


def test_the_same_geometry_with_other_images_is_no_loop() -> None:
    keyframes, _, _ = tracked()
    glue = Glue(config())
    here, there = keyframes[0], keyframes[-1]
    view = there.features.view
    noise = np.random.default_rng(0).integers(0, 256, view.grey.shape, np.uint8)
    repainted = replace(there, features=glue.extract(replace(view, grey=noise)))
    assert loop_edge(here, repainted, glue, config()) is None
