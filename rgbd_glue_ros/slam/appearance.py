"""Finds earlier keyframes that look like a new one: candidates for loops, without any pose.

A Hamming binary search tree (Schlegel and Grisetti 2018) holds the ORB descriptors of all
keyframes; nothing is trained beforehand, and a search takes a few milliseconds whatever their
number. The results are only candidates.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rgbd_glue_ros.errors import MissingExtraError
from rgbd_glue_ros.types import UInt8

DESCRIPTORS = 200
"""Number of strongest descriptors per image."""

MAX_DISTANCE_BITS = 50
"""Of 256 bits: descriptors that differ by more are of different points."""


@dataclass(frozen=True)
class Likeness:
    """How much an earlier keyframe looks like the new one.

    Attributes:
        number: of the earlier keyframe.
        matches: number of descriptors shared with the new one.
    """

    number: int
    matches: int


class Appearance(Protocol):
    """Keyframes indexed by appearance."""

    def add(self, number: int, descriptors: UInt8) -> None:
        """Adds a keyframe with binary descriptors [N, 32], strongest first."""

    def like(self, descriptors: UInt8) -> list[Likeness]:
        """All keyframes that share a descriptor with these [N, 32], most similar first."""


class SearchTree:
    """The binary search tree of pyHBST."""

    def __init__(self) -> None:
        """Creates an empty tree.

        Raises:
            MissingExtraError: pyHBST is not installed.
        """
        try:
            import pyhbst  # noqa: PLC0415
        except ImportError as error:
            raise MissingExtraError("pyHBST", "slam", "recognising places") from error
        self._tree: Any = pyhbst.BinarySearchTree256()
        self._split = pyhbst.SplittingStrategy.SplitEven

    def add(self, number: int, descriptors: UInt8) -> None:
        """Adds a keyframe with binary descriptors [N, 32], strongest first."""
        bits = _bits(descriptors)
        if bits:
            self._tree.add([(0.0, 0.0)] * len(bits), bits, number, self._split)

    def like(self, descriptors: UInt8) -> list[Likeness]:
        """All keyframes that share a descriptor with these [N, 32], most similar first."""
        bits = _bits(descriptors)
        if not bits or not self._tree.trainedIdentifiers():
            return []
        places = [(0.0, 0.0)] * len(bits)
        nobody = 2**31
        scores = self._tree.getScorePerImage(places, bits, nobody, True, MAX_DISTANCE_BITS)
        matches = {s.identifier_reference: s.number_of_matches for s in scores}
        return most_alike_first(Likeness(*row) for row in matches.items() if row[1])


def most_alike_first(likenesses: Iterable[Likeness]) -> list[Likeness]:
    """Sorts by the number of matches, and equal ones by the keyframe."""
    return sorted(likenesses, key=lambda likeness: (-likeness.matches, likeness.number))


def _bits(descriptors: UInt8) -> list[list[bool]]:
    bits: list[list[bool]] = np.unpackbits(descriptors[:DESCRIPTORS], axis=1).astype(bool).tolist()
    return bits
