"""Stamps of the same moment are paired, each once."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rgbd_glue_ros.trajectories.association import associate


def test_association_takes_the_nearest_pair_first_and_each_stamp_once() -> None:
    first = np.array([0, 10, 20]) * 1_000_000
    second = np.array([9, 11, 40, 3]) * 1_000_000
    rows, other = associate(first, second, 0.02)
    # 10 takes 9 before 11 (of equal distance the earlier row), and 20 what is left of them
    assert list(zip(rows.tolist(), other.tolist(), strict=True)) == [(0, 3), (1, 0), (2, 1)]


@given(
    st.lists(st.integers(0, 200), max_size=12),
    st.lists(st.integers(0, 200), max_size=12),
    st.integers(0, 30),
)
def test_association_is_one_to_one_within_the_difference_and_leaves_no_pair_unmade(
    a: list[int], b: list[int], milliseconds: int
) -> None:
    first, second = (np.array(x, np.int64) * 1_000_000 for x in (a, b))
    rows, other = associate(first, second, milliseconds / 1000)
    assert len(set(rows.tolist())) == len(rows) == len(set(other.tolist()))
    assert (np.abs(first[rows] - second[other]) <= milliseconds * 1_000_000).all()
    assert (np.diff(first[rows]) >= 0).all()
    unpaired = np.delete(first, rows)[:, None] - np.delete(second, other)[None, :]
    assert (np.abs(unpaired) > milliseconds * 1_000_000).all()
