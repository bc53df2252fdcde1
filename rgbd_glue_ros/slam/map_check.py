"""Checks the arrays of a map file, so that whatever is computed from them is of use.

Stamps may go back: of two sessions in a map, the second may replay the recording of the first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rgbd_glue_ros.slam.optimiser import unlinked
from rgbd_glue_ros.types import Float64, PoseGraphEdge
from rgbd_glue_ros.types.checks import FARTHEST_READ_M, are_rigid

_NOT_SYMMETRIC = 1e-6


def numbers(arrays: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> Float64:
    """An array of finite numbers.

    Raises:
        KeyError: there is no such array.
        ValueError: it has another shape or type, or a number in it is not finite.
    """
    array = np.asarray(arrays[name])
    if array.shape != shape or array.dtype.kind not in "fiu":
        raise ValueError(f"{name} are {array.dtype} {list(array.shape)} in place of {list(shape)}")
    is_finite = np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    _refuse(~is_finite, name, "not finite")
    return np.asarray(array, np.float64)


def transforms(arrays: Mapping[str, Any], name: str, count: int) -> Float64:
    """Rigid transforms, float64 [count, 4, 4].

    Raises:
        KeyError: there is no such array.
        ValueError: one is no rotation and translation.
    """
    T = numbers(arrays, name, (count, 4, 4))
    is_near = (np.abs(T[:, :3, 3]) < FARTHEST_READ_M).all(axis=1)
    _refuse(~(are_rigid(T) & is_near), name, "no rotation and translation")
    return T


def covariances(arrays: Mapping[str, Any], name: str, count: int) -> Float64:
    """Covariances, float64 [count, 6, 6].

    Raises:
        KeyError: there is no such array.
        ValueError: one is not symmetric and positive definite.
    """
    C = numbers(arrays, name, (count, 6, 6))
    variances = np.diagonal(C, axis1=1, axis2=2)
    _refuse((variances <= 0).any(axis=1), name, "not positive definite")
    # as correlations, so that metres of a lost camera leave digits for milliradians
    sigmas = np.sqrt(variances)
    correlations = C / sigmas[:, :, None] / sigmas[:, None, :]
    with np.errstate(all="ignore"):
        apart = np.abs(correlations - np.swapaxes(correlations, 1, 2)).max(axis=(1, 2), initial=0.0)
    is_usable = np.isfinite(correlations).all(axis=(1, 2)) & (apart < _NOT_SYMMETRIC)
    _refuse(~is_usable, name, "not symmetric")
    is_definite = np.linalg.eigvalsh(correlations).min(axis=1) > 0
    _refuse(~is_definite, name, "not positive definite")
    return C


def check_edges(edges: Sequence[PoseGraphEdge], count: int) -> None:
    """Refuses edges that lead nowhere, and keyframes that none leads to.

    Args:
        edges: between rows.
        count: of the keyframes.

    Raises:
        ValueError: there are such.
    """
    for edge in edges:
        if not (0 <= edge.parent < count and 0 <= edge.child < count):
            raise ValueError("an edge of a keyframe that is missing")
        if edge.parent == edge.child:
            raise ValueError(f"an edge of keyframe {edge.parent} to itself")
    lost = unlinked(range(1, count), edges, {0})
    if lost:
        raise ValueError(f"no edges lead from keyframe {lost[0]} to the first")


def _refuse(bad: Any, name: str, what: str) -> None:
    rows = np.flatnonzero(bad)
    if len(rows):
        raise ValueError(f"{name}: row {rows[0]} is {what}")
