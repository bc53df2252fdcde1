"""Checks of parameters whose values are texts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from rgbd_glue_ros.types.checks import FARTHEST_M


@dataclass(frozen=True)
class Check:
    """A check that type, range and choices cannot express.

    Attributes:
        allowed: what passes, in words.
        fault: says what is wrong with a value; None if nothing is.
    """

    allowed: str
    fault: Callable[[str], str | None]


def _pose_fault(text: str) -> str | None:
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        return f"{text!r} is not a list of numbers"
    if len(numbers) not in {6, 7} or not all(map(math.isfinite, numbers)):
        return f"{text!r} is not six or seven finite numbers"
    if max(map(abs, numbers)) > FARTHEST_M:
        return f"{text!r} is farther away than {FARTHEST_M:.0e} m, or turned more than as many rad"
    length = math.hypot(*numbers[3:])
    if len(numbers) == 7 and abs(length - 1.0) > 0.01:
        return f"the quaternion's length is {length:.3g}, not 1"
    return None


def _frame_fault(text: str) -> str | None:
    if len(text.split()) != 1 or not text.isprintable() or text.endswith("/") or "//" in text:
        return f"{text!r} is not a valid frame name"
    if text.startswith("/"):
        return f"{text!r} begins with a slash, which TF does not accept in ROS 2"
    return None


def _width_fault(text: str) -> str | None:
    width = int(text)
    return None if width == 0 or width >= LEAST_WIDTH_PX else f"{text} pixels are too few"


def _k_fault(text: str) -> str | None:
    return None if float(text) == 0 or float(text) >= 1 else f"{text} is out of range"


def or_nothing(check: Check) -> Check:
    """``check``, but an empty text passes too."""
    return Check(f"{check.allowed}, or nothing", lambda text: check.fault(text) if text else None)


LEAST_WIDTH_PX = 32
"""Narrower images show neither texture nor surfaces."""

MOST_WIDTH_PX = 100_000
"""No camera has wider images."""

WIDTH = Check(
    f"a whole number from {LEAST_WIDTH_PX} to {MOST_WIDTH_PX} (pixels), or 0", _width_fault
)
"""The width of an image, or 0 for whatever it has."""

K = Check("a number from 1 to 100, or 0", _k_fault)
"""Multiple of RANSAC's threshold, or 0 for the paper's choice."""

POSE = Check("'x y z roll pitch yaw' (m, rad) or 'x y z qx qy qz qw'", _pose_fault)
"""A pose: numbers separated by blanks or commas; roll, pitch, yaw are rotations about fixed axes
in this order, as in URDF."""

FRAME = Check("the name of a frame", _frame_fault)
"""One word, as TF names frames."""
