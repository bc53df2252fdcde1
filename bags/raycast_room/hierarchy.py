"""A bounding-volume hierarchy, so that a ray looks at a few primitives and not at all of them."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.types import Float64, Int64


def build(low: Float64, high: Float64) -> tuple[Float64, Int64, Int64]:
    """The hierarchy of boxes given by their corners, laid out depth first.

    Splits by the surface-area heuristic (MacDonald and Booth 1990): a ray meets a box with
    probability proportional to its area.

    Args:
        low: least corner of each primitive's box, [P, 3].
        high: greatest corner, [P, 3].

    Returns:
        Of each of the B nodes: its box [B, 6] (low, high), the node to go on with when the ray
        misses it [B], and its primitive [B], -1 for an inner node (go on with the next).
    """
    boxes: list[Float64] = []
    skip: list[int] = []
    leaf: list[int] = []

    def add(members: Int64) -> None:
        node = len(boxes)
        boxes.append(np.concatenate([low[members].min(axis=0), high[members].max(axis=0)]))
        skip.append(-1)
        leaf.append(int(members[0]) if len(members) == 1 else -1)
        if len(members) > 1:
            first, second = _split(members, low, high)
            add(first)
            add(second)
        skip[node] = len(boxes)

    add(np.arange(len(low)))
    return np.array(boxes), np.array(skip, np.int64), np.array(leaf, np.int64)


def _split(members: Int64, low: Float64, high: Float64) -> tuple[Int64, Int64]:
    """The two parts of least expected cost."""
    best, parts = np.inf, (members[:1], members[1:])
    centre = low[members] + high[members]
    for axis in range(3):
        ordered = members[np.argsort(centre[:, axis], kind="stable")]
        before = _growing_areas(low[ordered], high[ordered])
        after = _growing_areas(low[ordered[::-1]], high[ordered[::-1]])[::-1]
        count = np.arange(1, len(members))
        cost = before[:-1] * count + after[1:] * (len(members) - count)
        at = int(cost.argmin())
        if cost[at] < best:
            best, parts = float(cost[at]), (ordered[: at + 1], ordered[at + 1 :])
    return parts


def _growing_areas(low: Float64, high: Float64) -> Float64:
    """Half the surface of the box about the first 1, 2, … N boxes, [N]."""
    size = np.maximum.accumulate(high) - np.minimum.accumulate(low)
    x, y, z = size.T
    area: Float64 = x * y + y * z + z * x
    return area
