"""Random motions, and matches made with a known one."""

from __future__ import annotations

from functools import partial

import numpy as np
from hypothesis import strategies as st

from rgbd_glue_ros.features.lifting import PointsAt
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.motion_compensation import keypoints_to_points
from rgbd_glue_ros.types import Correspondences, Float64, View

SEEDS = st.integers(0, 2**32 - 1)


def twists(max_length: float = 5.0, max_angle: float = 3.1) -> st.SearchStrategy[Float64]:
    """Twists (v, omega) with v up to ``max_length`` and omega up to ``max_angle`` long."""
    parts = st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * 6)
    scale = np.repeat([max_length, max_angle], 3) / np.sqrt(3)
    return parts.map(lambda values: np.array(values) * scale)


def transforms() -> st.SearchStrategy[Float64]:
    return twists().map(se3.exp)


def random_transform(rng: np.random.Generator) -> Float64:
    return se3.exp(rng.uniform(-1, 1, 6))


def room_points(rng: np.random.Generator, count: int) -> Float64:
    """Points in front of a camera in a room, float64 [count, 3]."""
    return rng.uniform([-1.5, -1.0, 1.0], [1.5, 1.0, 4.0], (count, 3))


def noisy_matches(
    rng: np.random.Generator, T: Float64, count: int, sigma_m: float
) -> Correspondences:
    """Matches that T maps upon each other but for noise N(0, sigma²) on every axis."""
    source = room_points(rng, count)
    target = se3.transform(T, source) + rng.normal(0, sigma_m, (count, 3))
    return Correspondences(source, target, np.ones(count))


def wrong_matches(rng: np.random.Generator, count: int) -> Correspondences:
    """Matches that have nothing to do with each other."""
    return Correspondences(room_points(rng, count), room_points(rng, count), np.ones(count))


def points_of(view: View) -> PointsAt:
    """The points at all pixels of a view."""
    return partial(keypoints_to_points, view=view)
