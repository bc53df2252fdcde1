"""The bundled recording as an odometry with drift would have tracked it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config, load_preset, with_values
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.types import Float64, PoseGraphEdge
from rigs.bag_frames import recorded_frames, true_poses

CHANGED = {
    "odometry.keyframe_translation": 0.06,
    "odometry.keyframe_rotation": 0.06,
    "odometry.window": 2,
    "odometry.drift_radius": 0.0,
}
"""Keyframes near each other, and drift left in: what loops are to find."""

_DRIFT_M, _DRIFT_RAD = 0.005, 0.002
# of somebody who drifts so, and knows
_DRIFT_COVARIANCE = np.diag([_DRIFT_M**2] * 3 + [_DRIFT_RAD**2] * 3)


@dataclass(frozen=True)
class Drifted:
    """A keyframe.

    Attributes:
        row: of the recorded frames.
        keyframe: as the map keeps it, where it was tracked.
        T_odom_camera: where drift has it.
        T_true: where it was.
        edges: to earlier keyframes, with the same drift.
    """

    row: int
    keyframe: MapKeyframe
    T_odom_camera: Float64
    T_true: Float64
    edges: tuple[PoseGraphEdge, ...]


@lru_cache(maxsize=1)
def config() -> Config:
    """The live preset with ``CHANGED``."""
    return with_values(load_preset("live"), CHANGED)


@lru_cache(maxsize=1)
def drifted() -> tuple[Drifted, ...]:
    """The keyframes: 5 mm and 2 mrad of drift with each."""
    odometry = Odometry(config())
    found: list[Drifted] = []
    for row, frame in enumerate(recorded_frames()):
        estimate = odometry.process(frame)
        newest = odometry.newest_keyframe
        if not estimate.is_keyframe:
            continue
        assert newest is not None
        assert estimate.T_odom_camera is not None
        T = _drifting(estimate.T_odom_camera, len(found))
        edges = []
        for edge in estimate.edges:
            T_parent = found[edge.parent].T_odom_camera
            edges.append(
                replace(
                    edge,
                    T_parent_child=se3.inverse(T_parent) @ T,
                    covariance=edge.covariance + _DRIFT_COVARIANCE,
                )
            )
        kept = MapKeyframe.of(newest, estimate.T_odom_camera)
        found.append(Drifted(row, kept, T, true_poses()[row], tuple(edges)))
    return tuple(found)


def rmse(poses: Float64, truth: Float64) -> float:
    """Of positions, after the first poses were laid upon each other, metres."""
    T = truth[0] @ se3.inverse(poses[0])
    return float(np.sqrt(np.mean(np.sum(((T @ poses) - truth)[:, :3, 3] ** 2, axis=1))))


def _drifting(T: Float64, number: int) -> Float64:
    step = se3.exp(np.array([_DRIFT_M, 0, 0, 0, _DRIFT_RAD, 0]))
    return np.linalg.matrix_power(step, number) @ T
