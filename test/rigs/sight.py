"""What a map recognises."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rgbd_glue_ros.slam import loop_finder
from rgbd_glue_ros.slam.loop_closure import loop_edge
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.types import PoseGraphEdge


class Sight:
    """In place of ``loop_edge``.

    Attributes:
        is_blind: whether it finds no loop at all.
        is_useless: whether no optimum exists with the loops that it finds.
        failing: numbers of keyframes for which it fails.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.is_blind = True
        self.is_useless = False
        self.failing: set[int] = set()
        monkeypatch.setattr(loop_finder, "loop_edge", self)

    def __call__(
        self, parent: MapKeyframe, child: MapKeyframe, *others: Any
    ) -> PoseGraphEdge | None:
        """The loop between two keyframes."""
        if child.row in self.failing:
            raise ArithmeticError("no digits are left")
        loop = None if self.is_blind else loop_edge(parent, child, *others)
        if loop is None or not self.is_useless:
            return loop
        return replace(loop, covariance=np.full((6, 6), np.nan))
