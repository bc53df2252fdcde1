"""Images that a driver sends again: bit for bit the same, at another stamp."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.types import NANOSECONDS, Float32, Float64, View

SOON_NS = NANOSECONDS // 10
"""Images that stay the same for longer come from a simulated camera that stands still."""

# A camera that moves by no more metres and radians per second, added, is at rest: what a simulated
# one sees then is the same in every image.
_AT_REST = 0.02
# Images are compared here first: two that differ mostly do so in every part.
_SAMPLE = (slice(None, None, 16), slice(None, None, 16))


@dataclass(frozen=True)
class LastDepth:
    """The last depth image that was not that of the frame before again.

    A driver that pairs every colour image with some depth sends depth a second time when it has no
    newer: from a camera whose depth has half the rate, or after a lost packet. That depth is as old
    as its first frame, and where the camera was then.

    Attributes:
        depth: float32 [H, W], metres.
        stamp_ns: of the frame that it came with first.
    """

    depth: Float32
    stamp_ns: int

    @staticmethod
    def after(last: LastDepth | None, view: View, stamp_ns: int) -> LastDepth:
        """The last depth after a frame at a stamp; ``last`` is None at the first."""
        if last is not None and _are_identical(view.depth, last.depth):
            return last
        return LastDepth(view.depth, stamp_ns)

    def dated(self, view: View, stamp_ns: int) -> View:
        """The view of a frame at a stamp, whose depth this is, with when it was taken.

        That of a camera at rest may be new. Older than ``SOON_NS`` it is taken for new, as the
        velocity does not tell any more where the camera was.
        """
        age_ns = stamp_ns - self.stamp_ns
        if age_ns > SOON_NS or is_at_rest(view.twist):
            return view
        return replace(view, depth_delay=view.depth_delay - age_ns / NANOSECONDS)


def is_at_rest(twist: Float64) -> bool:
    """Whether a camera with this twist [6] may see the same again."""
    speeds = np.linalg.norm(twist.reshape(2, 3), axis=1)
    return bool(speeds.sum() <= _AT_REST)


def show_the_same(view: View, other: View) -> bool:
    """Whether two views have bit-identical images."""
    return _are_identical(view.grey, other.grey) and _are_identical(view.depth, other.depth)


def _are_identical(image: NDArray[Any], other: NDArray[Any]) -> bool:
    """Whether two images [H, W] are the same to the bit, and unknown at the same pixels."""
    if image.shape != other.shape:
        return False
    # unknown depth, NaN, is not equal to itself
    bits = f"u{image.itemsize}"
    a, b = image.view(bits), other.view(bits)
    return np.array_equal(a[_SAMPLE], b[_SAMPLE]) and np.array_equal(a, b)
