"""What looks alike is found, by the tree as by votes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from rigs.hamming_votes import HammingVotes

from rgbd_glue_ros.slam.appearance import DESCRIPTORS, Appearance, SearchTree
from rgbd_glue_ros.types import UInt8


def _tree() -> Appearance:
    pytest.importorskip("pyhbst", reason="pyHBST is not installed")
    return SearchTree()


KINDS = pytest.mark.parametrize("create", [HammingVotes, _tree])


def places(count: int) -> list[UInt8]:
    rng = np.random.default_rng(0)
    return [rng.integers(0, 256, (DESCRIPTORS, 32), np.uint8) for _ in range(count)]


def seen_again(descriptors: UInt8, kept: int, flipped_bits: int) -> UInt8:
    """Some of the descriptors with a few bits flipped, among others that are new."""
    rng = np.random.default_rng(1)
    bits = np.unpackbits(descriptors, axis=1)
    for row in bits:
        row[rng.choice(256, flipped_bits, replace=False)] ^= 1
    again = np.packbits(bits, axis=1)
    again[kept:] = rng.integers(0, 256, again[kept:].shape, np.uint8)
    return np.asarray(again[rng.permutation(len(again))], np.uint8)


@KINDS
def test_a_place_seen_again_is_the_most_alike(create: Callable[[], Appearance]) -> None:
    appearance = create()
    known = places(30)
    for number, descriptors in enumerate(known):
        appearance.add(number, descriptors)
    for number in (0, 13, 29):
        first, *others = appearance.like(seen_again(known[number], 80, 10))
        assert first.number == number
        assert first.matches >= 40
        assert all(other.matches < 5 for other in others)


@KINDS
def test_a_place_never_seen_matches_no_known_place(create: Callable[[], Appearance]) -> None:
    appearance = create()
    assert appearance.like(places(1)[0]) == []
    *known, new = places(20)
    for number, descriptors in enumerate(known):
        appearance.add(number, descriptors)
    assert all(likeness.matches < 5 for likeness in appearance.like(new))


@KINDS
def test_an_image_without_features_is_taken_and_like_none(create: Callable[[], Appearance]) -> None:
    appearance = create()
    appearance.add(0, places(1)[0])
    nothing = np.empty((0, 32), np.uint8)
    appearance.add(1, nothing)
    assert appearance.like(nothing) == []
