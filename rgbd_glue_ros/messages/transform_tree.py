"""A tree of frames with transforms over time, as on /tf; does not depend on ROS."""

from __future__ import annotations

import logging
import threading
import time
from bisect import bisect_left
from dataclasses import dataclass, field

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages.channel_queue import BACKWARD_JUMP_NS
from rgbd_glue_ros.types import NANOSECONDS, Float64

TF, TF_STATIC = "/tf", "/tf_static"
"""The topics of transforms."""

HISTORY_NS = 10 * NANOSECONDS
# No robot has more; a publisher that keeps inventing names must not fill the memory.
MOST_FRAMES = 10_000
MOST_POSES = 10_000

logger = logging.getLogger(__name__)


@dataclass
class _Edge:
    """A frame's pose in its parent over time: T_parent_child [4, 4] by stamp, or a static one."""

    parent: str
    stamps_ns: list[int] = field(default_factory=list)
    poses: list[Float64] = field(default_factory=list)
    is_static: bool = False

    def add(self, stamp_ns: int, T_parent_child: Float64) -> None:
        if self.stamps_ns and stamp_ns < self.stamps_ns[-1] - BACKWARD_JUMP_NS:
            self.stamps_ns.clear()  # time went back, as when a bag loops
            self.poses.clear()
        at = bisect_left(self.stamps_ns, stamp_ns)
        if self.stamps_ns[at : at + 1] == [stamp_ns]:
            self.poses[at] = T_parent_child
            return
        self.stamps_ns.insert(at, stamp_ns)
        self.poses.insert(at, T_parent_child)
        old = bisect_left(self.stamps_ns, self.stamps_ns[-1] - HISTORY_NS)
        old = max(old, len(self.stamps_ns) - MOST_POSES)
        del self.stamps_ns[:old], self.poses[:old]

    def at(self, stamp_ns: int | None) -> Float64 | None:
        """T_parent_child at a stamp, or the newest without a stamp; None if it is unknown."""
        if self.is_static or stamp_ns is None:
            return self.poses[-1]
        after = bisect_left(self.stamps_ns, stamp_ns)
        if self.stamps_ns[after : after + 1] == [stamp_ns]:
            return self.poses[after]
        if after in {0, len(self.stamps_ns)}:
            return None  # not extrapolated
        before, earlier_ns = self.poses[after - 1], self.stamps_ns[after - 1]
        fraction = (stamp_ns - earlier_ns) / (self.stamps_ns[after] - earlier_ns)
        step = se3.log(se3.inverse(before) @ self.poses[after])
        T_parent_child: Float64 = before @ se3.exp(fraction * step)
        return T_parent_child


class TransformTree:
    """The known transforms of a tree of frames; thread-safe."""

    def __init__(self) -> None:
        self._edges: dict[str, _Edge] = {}
        self._is_full = False
        self._changed = threading.Condition()

    def add(self, parent: str, child: str, T_parent_child: Float64, stamp_ns: int | None) -> None:
        """Adds the pose [4, 4] of a frame in another at a stamp, or a static one without."""
        with self._changed:
            edge = self._edges.get(child)
            if edge is None and len(self._edges) >= MOST_FRAMES:
                self._say_full(child)
                return
            is_static = stamp_ns is None
            if edge is None or edge.parent != parent or edge.is_static != is_static:
                edge = self._edges[child] = _Edge(parent, is_static=is_static)
            if stamp_ns is None:
                edge.poses = [T_parent_child]
            else:
                edge.add(stamp_ns, T_parent_child)
            self._changed.notify_all()

    def _say_full(self, child: str) -> None:
        if not self._is_full:
            self._is_full = True
            logger.warning(
                "TF has more than %d frames; %s and all further ones are ignored",
                MOST_FRAMES,
                child,
            )

    def lookup(
        self, target: str, source: str, stamp_ns: int | None, timeout_s: float
    ) -> Float64 | None:
        """Looks up T_target_source [4, 4], interpolated with constant velocity.

        Args:
            target: frame to map to.
            source: frame to map from.
            stamp_ns: time, nanoseconds; None for the newest transforms.
            timeout_s: how long to wait for it, seconds.

        Returns:
            The transform; None if it was not available in time. Nothing is extrapolated.
        """
        end = time.monotonic() + timeout_s
        with self._changed:
            while True:
                found = self._lookup(target, source, stamp_ns)
                left = end - time.monotonic()
                if found is not None or left <= 0:
                    return found
                self._changed.wait(left)

    def time_went_back(self) -> None:
        """Does nothing: each frame forgets its past when its first transform after a jump comes."""

    def _lookup(self, target: str, source: str, stamp_ns: int | None) -> Float64 | None:
        from_source, from_target = self._way_up(source), self._way_up(target)
        common = next((frame for frame in from_source if frame in from_target), None)
        if common is None:
            return None
        T_common_source = self._along(from_source[: from_source.index(common)], stamp_ns)
        T_common_target = self._along(from_target[: from_target.index(common)], stamp_ns)
        if T_common_source is None or T_common_target is None:
            return None
        T_target_source: Float64 = se3.inverse(T_common_target) @ T_common_source
        return T_target_source

    def _way_up(self, frame: str) -> list[str]:
        """The frame, its parent, and so on; stops before a cycle."""
        way = [frame]
        while way[-1] in self._edges and self._edges[way[-1]].parent not in way:
            way.append(self._edges[way[-1]].parent)
        return way

    def _along(self, frames: list[str], stamp_ns: int | None) -> Float64 | None:
        """Pose of the first frame in the parent of the last one."""
        T: Float64 = np.eye(4)
        for frame in frames:
            step = self._edges[frame].at(stamp_ns)
            if step is None:
                return None
            T = step @ T
        return T
