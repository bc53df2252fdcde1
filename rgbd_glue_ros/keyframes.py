"""Keyframes: frames with a pose that others are registered and refined against."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros import se3
from rgbd_glue_ros.glue import FrameFeatures
from rgbd_glue_ros.model import Model
from rgbd_glue_ros.types import Float64


@dataclass(frozen=True)
class Keyframe:
    """A frame that others are registered against.

    Attributes:
        number: counted from 0.
        stamp_ns: of the frame.
        T_odom_camera: float64 [4, 4].
        covariance: float64 [6, 6] of the pose, perturbation on the left, odom frame.
        features: of the frame.
        model: its planes and pixels, in the odom frame.
    """

    number: int
    stamp_ns: int
    T_odom_camera: Float64
    covariance: Float64
    features: FrameFeatures
    model: Model


class Keyframes:
    """The last few keyframes; the oldest goes when a new one comes."""

    def __init__(self, capacity: int) -> None:
        self._kept: deque[Keyframe] = deque(maxlen=capacity)
        self._count = 0

    def __len__(self) -> int:
        return len(self._kept)

    def __iter__(self) -> Iterator[Keyframe]:
        return iter(self._kept)

    def add(
        self,
        stamp_ns: int,
        T_odom_camera: Float64,
        covariance: Float64,
        features: FrameFeatures,
        model: Model,
    ) -> Keyframe:
        """Makes a keyframe of a frame; ``model`` is in its camera's frame."""
        moved = model.moved(T_odom_camera)
        keyframe = Keyframe(self._count, stamp_ns, T_odom_camera, covariance, features, moved)
        self._count += 1
        self._kept.append(keyframe)
        return keyframe

    def forget(self) -> None:
        """Drops all keyframes; numbers go on."""
        self._kept.clear()

    def latest(self, count: int) -> list[Keyframe]:
        """The last ``count`` keyframes, newest first."""
        return list(self._kept)[::-1][:count]

    def in_turn(self, count: int, turn: int) -> list[Keyframe]:
        """``count`` of all keyframes, newest first and other ones every turn, until all had theirs.

        Args:
            count: how many.
            turn: from 0, which has the newest.
        """
        newest_first = self.latest(len(self._kept))
        start = turn * count % max(len(newest_first), 1)
        return (newest_first[start:] + newest_first[:start])[:count]

    def nearest(self, T_odom_camera: Float64, window: int) -> list[Keyframe]:
        """The last ``window`` keyframes, those first that saw the room from most nearly there."""
        return sorted(
            self.latest(window), key=lambda k: _difference(k.T_odom_camera, T_odom_camera)
        )


def _difference(a: Float64, b: Float64) -> float:
    """How differently two cameras see a room: metres plus radians, as a room is metres wide."""
    T = se3.inverse(a) @ b
    return float(np.linalg.norm(T[:3, 3])) + se3.rotation_angle(T)
