"""Images that show less than was there."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from rgbd_glue_ros.types import RgbdFrame, View

Seen = TypeVar("Seen", RgbdFrame, View)


def without_depth(seen: Seen) -> Seen:
    return replace(seen, depth=np.full_like(seen.depth, np.nan))


def blacked_out(frame: RgbdFrame) -> RgbdFrame:
    return replace(frame, color=np.zeros_like(frame.color))


def covered(frame: RgbdFrame) -> RgbdFrame:
    """A hand before the lens: dark, and too near for depth."""
    return without_depth(blacked_out(frame))
