"""Place recognition by exhaustive search: what the tree is compared with, and used without it."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.features.matching import nearest_two
from rgbd_glue_ros.slam.appearance import DESCRIPTORS, MAX_DISTANCE_BITS, Likeness
from rgbd_glue_ros.types import UInt8


class HammingVotes:
    """An ``Appearance``: every descriptor votes for the keyframe with the nearest one."""

    def __init__(self) -> None:
        self._descriptors: list[UInt8] = []
        self._numbers: list[int] = []

    def add(self, number: int, descriptors: UInt8) -> None:
        """Adds a keyframe with binary descriptors [N, 32], strongest first."""
        strongest = descriptors[:DESCRIPTORS]
        self._descriptors.append(strongest)
        self._numbers += [number] * len(strongest)

    def like(self, descriptors: UInt8) -> list[Likeness]:
        """All keyframes that share a descriptor with these [N, 32], most similar first."""
        if len(self._numbers) < 2 or not len(descriptors):
            return []
        reference = np.concatenate(self._descriptors)
        nearest, distances = nearest_two(descriptors[:DESCRIPTORS], reference)
        voted = nearest[distances[:, 0] <= MAX_DISTANCE_BITS]
        numbers, votes = np.unique(np.array(self._numbers)[voted], return_counts=True)
        likenesses = [Likeness(*row) for row in zip(numbers.tolist(), votes.tolist(), strict=True)]
        return sorted(likenesses, key=lambda likeness: (-likeness.matches, likeness.number))
