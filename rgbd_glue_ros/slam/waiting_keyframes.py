"""Keyframes that are not in the map yet: they wait until one of them shows a place of it."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

from rgbd_glue_ros.slam.stored_keyframe import StoredKeyframe
from rgbd_glue_ros.types import PoseGraphEdge

logger = logging.getLogger(__name__)

MOST_WAITING = 1000
"""Keyframes that wait, at most: a gigabyte at 640x480."""


@dataclass(frozen=True)
class UnmappedKeyframe:
    """A keyframe that is not in the map yet.

    Attributes:
        number: the odometry's.
        keyframe: as the map will keep it; its number is its row.
        edges: to earlier keyframes, by the odometry's numbers.
    """

    number: int
    keyframe: StoredKeyframe
    edges: tuple[PoseGraphEdge, ...]


class WaitingKeyframes:
    """Those that wait, in order.

    If there are too many, the oldest are left out: only the newest lead on to the place that will
    be recognised.
    """

    def __init__(self, map_name: str) -> None:
        """Without keyframes.

        Args:
            map_name: the map's, for a warning.
        """
        self._map_name = map_name
        self._keyframes: list[UnmappedKeyframe] = []
        self._has_warned = False

    def __len__(self) -> int:
        return len(self._keyframes)

    def clear(self) -> None:
        """Removes all."""
        self._keyframes.clear()

    def add(self, new: UnmappedKeyframe) -> None:
        """Adds a keyframe."""
        self._keyframes.append(new)
        if len(self._keyframes) > MOST_WAITING:
            del self._keyframes[0]
            self._warn()

    def add_edge(self, edge: PoseGraphEdge) -> None:
        """Adds a later edge to a keyframe, by the odometry's numbers, if its child waits."""
        self._keyframes = [
            replace(k, edges=(*k.edges, edge)) if k.number == edge.child else k
            for k in self._keyframes
        ]

    def numbered(self, first_row: int) -> list[UnmappedKeyframe]:
        """All of them, with their rows from the first on."""
        return [
            replace(k, keyframe=replace(k.keyframe, row=row))
            for row, k in enumerate(self._keyframes, first_row)
        ]

    def _warn(self) -> None:
        if not self._has_warned:
            self._has_warned = True
            logger.warning(
                "%s: none of its places was recognised in %d keyframes: from now on the oldest of "
                "them are left out of the map. Move the camera to a place of the map, or give the "
                "map of this place, or none (logged once)",
                *(self._map_name, MOST_WAITING),
            )
