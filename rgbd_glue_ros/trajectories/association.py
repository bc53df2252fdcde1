"""Pairs of stamps of the same moment."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.types import NANOSECONDS, Int64

MAX_TIME_DIFFERENCE_S = 0.02
"""Stamps further apart than this are not of the same moment (the TUM tools' value)."""


def associate(
    first_ns: Int64, second_ns: Int64, max_difference_s: float = MAX_TIME_DIFFERENCE_S
) -> tuple[Int64, Int64]:
    """Pairs stamps one-to-one, the nearest pair first, as the TUM benchmark's tools do.

    Args:
        first_ns: int64 [N], in any order.
        second_ns: int64 [M], in any order.
        max_difference_s: maximum difference within a pair, seconds.

    Returns:
        The rows of ``first_ns`` and of ``second_ns`` that belong together, in order of
        ``first_ns``' time.
    """
    window = round(max_difference_s * NANOSECONDS)
    order = np.argsort(second_ns, kind="stable")
    start = np.searchsorted(second_ns, first_ns - window, "left", sorter=order)
    stop = np.searchsorted(second_ns, first_ns + window, "right", sorter=order)
    candidates = sorted(
        (abs(int(first_ns[i]) - int(second_ns[j])), i, int(j))
        for i in range(len(first_ns))
        for j in order[start[i] : stop[i]]
    )
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, j in candidates:
        if i not in pairs and j not in taken:
            pairs[i] = j
            taken.add(j)
    rows = np.fromiter(pairs, np.int64, len(pairs))
    rows = rows[np.argsort(first_ns[rows], kind="stable")]
    return rows, np.array([pairs[int(i)] for i in rows], np.int64)
