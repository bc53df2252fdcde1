"""Images that wait until the odometry says which of them are keyframes; does not depend on ROS."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Collection
from typing import Generic, TypeVar

from rgbd_glue_ros.types import NANOSECONDS

Item = TypeVar("Item")

# A keyframe is published some milliseconds after the pose of its frame.
_AFTER_POSE_NS = NANOSECONDS
# Odometry that takes longer for a frame is of no use; without poses, as while it is lost, this
# bounds what is kept.
_LONGEST_NS = 2 * NANOSECONDS


class RecentImages(Generic[Item]):
    """Images by their stamps; those that can no longer be of a keyframe are dropped."""

    def __init__(self, needed: Callable[[], Collection[int]]) -> None:
        """Starts without images.

        Args:
            needed: returns stamps of images that are not dropped, however old; nanoseconds.
        """
        self._needed = needed
        self._items: OrderedDict[int, Item] = OrderedDict()
        self._tracked_ns: int | None = None

    def __len__(self) -> int:
        return len(self._items)

    def add(self, stamp_ns: int, item: Item) -> None:
        """Adds the images of a frame; if time went back, those before are dropped."""
        if self._items and stamp_ns < next(reversed(self._items)):
            self._items.clear()
        self._items[stamp_ns] = item
        self._drop_old()

    def track(self, stamp_ns: int) -> None:
        """Takes note that the odometry has the pose of a frame."""
        self._tracked_ns = stamp_ns
        self._drop_old()

    def at(self, stamp_ns: int) -> Item | None:
        """The images with this stamp; None if there are none."""
        return self._items.get(stamp_ns)

    def may_come(self, stamp_ns: int) -> bool:
        """Whether images with this stamp, which are not there, may still arrive."""
        return not self._items or next(reversed(self._items)) < stamp_ns

    def _drop_old(self) -> None:
        if not self._items:
            return
        newest_ns = next(reversed(self._items))
        oldest_ns = newest_ns - _LONGEST_NS
        if self._tracked_ns is not None:
            # a pose from before time went back is newer than all images
            oldest_ns = max(oldest_ns, min(self._tracked_ns, newest_ns) - _AFTER_POSE_NS)
        needed = self._needed()
        for stamp_ns in [s for s in self._items if s < oldest_ns and s not in needed]:
            del self._items[stamp_ns]
