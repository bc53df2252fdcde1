"""Keyframes and edges of the odometry, each keyframe with its images."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rgbd_glue_ros.live.odometry_faults import explain_late_start
from rgbd_glue_ros.live.recent_images import RecentImages
from rgbd_glue_ros.messages.synchronizer import Match
from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.node.rgbd_input import RgbdInput
from rgbd_glue_ros.slam.keyframe_stream import KeyframeStream, NewKeyframe
from rgbd_glue_ros.types import Float64, PoseGraphEdge

KEYFRAMES_WAITING = 100
"""Keyframes that wait for their images, and those that wait for the worker, at most."""


@dataclass(frozen=True)
class MatchedKeyframe:
    """A keyframe and its messages; None if they are missing."""

    keyframe: NewKeyframe
    match: Match[Any] | None


@dataclass(frozen=True, eq=False)
class NewGraph:
    """The odometry has restarted: what follows is not related to what came before."""


class KeyframeMatching:
    """Passes on keyframes and edges in order, once the images of a keyframe have arrived."""

    def __init__(
        self,
        node: BaseNode,
        images: RgbdInput,
        publishers: Callable[[], Sequence[str]],
        pass_on: Callable[[NewGraph | MatchedKeyframe | PoseGraphEdge], None],
    ) -> None:
        """Begins before the first message.

        Args:
            node: has the log.
            images: where they come from.
            publishers: returns the full names of the nodes that publish keyframes.
            pass_on: called with each keyframe and edge.
        """
        self._node = node
        self._input = images
        self._publishers = publishers
        self._pass_on = pass_on
        self._stream = KeyframeStream()
        self._matches: RecentImages[Match[Any]] = RecentImages(lambda: self._stream.awaited_ns)
        self._waiting: deque[NewGraph | NewKeyframe | PoseGraphEdge] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def add_images(self, match: Match[Any]) -> None:
        """Takes the images of a frame."""
        self._matches.add(match.stamp_ns, match)
        self._add([])

    def track(self, stamp_ns: int) -> None:
        """Takes note that the odometry has the pose of a frame."""
        self._matches.track(stamp_ns)

    def begin(self, stamp_ns: int) -> None:
        """Takes note that the odometry begins a graph with the keyframe of this stamp."""
        first = self._stream.begin(stamp_ns)
        self._begin_anew()
        self._add(first)

    def add_pose(self, stamp_ns: int, T_odom_child: Float64) -> None:
        """Takes the pose [4, 4] of a keyframe, in the published frames."""
        self._add(self._stream.add_pose(stamp_ns, T_odom_child))

    def add_edge(self, stamp_ns: int, edge: PoseGraphEdge) -> None:
        """Takes an edge, with the stamp of its child."""
        keyframes, late = self._stream.add_edge(stamp_ns, edge)
        self._add([*keyframes, *([] if late is None else [late])])

    def _add(self, items: Sequence[NewKeyframe | PoseGraphEdge]) -> None:
        for item in items:
            if isinstance(item, NewKeyframe) and item.is_anew:
                self._begin_anew()
                self._say_what_it_missed(item.number)
            self._waiting.append(item)
        while self._waiting and (
            len(self._waiting) > KEYFRAMES_WAITING or not self._is_awaited(self._waiting[0])
        ):
            oldest = self._waiting.popleft()
            if isinstance(oldest, NewKeyframe):
                self._pass_on_keyframe(oldest)
            else:
                self._pass_on(oldest)

    def _begin_anew(self) -> None:
        # images of the previous graph may never come, for example when time went back
        self._waiting.clear()
        self._waiting.append(NewGraph())

    def _say_what_it_missed(self, first: int) -> None:
        """Warns if the first keyframe that came of a graph is a later one."""
        if first > 0:
            self._node.warn_once("Map", explain_late_start(first, self._publishers()))

    def _is_awaited(self, item: NewGraph | NewKeyframe | PoseGraphEdge) -> bool:
        """Whether the images of a keyframe may still arrive."""
        if not isinstance(item, NewKeyframe) or self._matches.at(item.stamp_ns) is not None:
            return False
        return self._matches.may_come(item.stamp_ns)

    def _pass_on_keyframe(self, keyframe: NewKeyframe) -> None:
        match = self._matches.at(keyframe.stamp_ns)
        if match is None:
            why = (
                "images have no stamp, and each process receives them at a different time: make "
                "the driver stamp them"
                if self._input.is_by_receipt
                else "it was lost on the way, or this node's topics are not those of the odometry"
            )
            self._node.warn_once(
                f"keyframe {keyframe.number}",
                f"no image has its stamp, so it is skipped; {why}",
            )
        # even without images, its edges connect earlier keyframes with later ones
        self._pass_on(MatchedKeyframe(keyframe, match))
