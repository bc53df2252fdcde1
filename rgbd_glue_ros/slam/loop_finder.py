"""Finds loops of a keyframe: the earlier ones, also of a given map, that show the same place."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence

import numpy as np

from rgbd_glue_ros.features.visual import orb
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam.appearance import Appearance, Likeness, most_alike_first
from rgbd_glue_ros.slam.loop_closure import loop_edge
from rgbd_glue_ros.slam.map_file import OnKeyframe, SavedMap
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.slam.packed_view import PackedView, packed
from rgbd_glue_ros.slam.stored_keyframe import StoredKeyframe, WholeKeyframes
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraphEdge, UInt8

# Candidates that a keyframe is compared with, by appearance and by proximity: each costs as much as
# tracking a frame.
_MOST_ALIKE, _NEAREST = 2, 2
# Any two images may share fewer descriptors than this.
_MIN_MATCHES = 12
# Keyframes nearer than this, metres and radians added, see the same.
_NEAR = 0.8


class LoopFinder:
    """Keeps the keyframes of a map, and compares them. Edges and poses are its owner's.

    Attributes:
        session_start: number of the first keyframe that is not from a given map.
        keyframes: all so far, by number.
    """

    def __init__(
        self, config: Config, glue: Glue, new_appearance: Callable[[], Appearance]
    ) -> None:
        """Without keyframes.

        Args:
            config: how keyframes are compared.
            glue: registers them, with that configuration.
            new_appearance: creates what finds similar keyframes.
        """
        self._config = config
        self._glue = glue
        self._orb = orb(config.features)
        self._whole = WholeKeyframes()
        # apart, so that a session can be forgotten without the given map
        self._new_appearance = new_appearance
        self._before, self._session = new_appearance(), new_appearance()
        self.session_start = 0
        self.keyframes: list[StoredKeyframe] = []

    def restore(
        self, saved: SavedMap, on_keyframe: OnKeyframe = lambda _done, _total: None
    ) -> None:
        """Adds the keyframes of a given map, first; later ones belong to another session.

        Args:
            saved: the map.
            on_keyframe: called after each keyframe.
        """
        graph = saved.graph.keyframes
        for number, (at_ns, T, view) in enumerate(
            zip(graph.stamps_ns.tolist(), graph.poses, saved.views, strict=True)
        ):
            keyframe = MapKeyframe.seen(number, at_ns, T, view.unpacked(), self._glue, self._config)
            self._before.add(number, self._descriptors(keyframe))
            self.keyframes.append(self._of_view(keyframe, view))
            on_keyframe(number + 1, len(saved))
        self.session_start = len(self.keyframes)

    def forget_session(self) -> None:
        """Removes all keyframes but those of the given map."""
        del self.keyframes[self.session_start :]
        self._session = self._new_appearance()

    def reconfigure(self, config: Config) -> None:
        """Compares by another configuration from now on, such as with what the odometry learnt."""
        self._config = config

    @property
    def views(self) -> tuple[PackedView, ...]:
        """The images of all keyframes."""
        return tuple(keyframe.view for keyframe in self.keyframes)

    def tracked(self, keyframe: MapKeyframe) -> StoredKeyframe:
        """A keyframe of the odometry, for ``add``."""
        return self._remembered(StoredKeyframe.with_model(keyframe), keyframe)

    def seen(self, keyframe: MapKeyframe) -> StoredKeyframe:
        """A keyframe that was ``MapKeyframe.seen``, for ``add``."""
        return self._remembered(self._of_view(keyframe, packed(keyframe.features.view)), keyframe)

    def add(self, keyframes: Sequence[StoredKeyframe]) -> None:
        """Adds keyframes, whose numbers are the next ones."""
        self.keyframes += keyframes

    def compare_and_index(
        self, stored: StoredKeyframe, linked: Container[int]
    ) -> tuple[PoseGraphEdge, ...]:
        """Compares a keyframe with similar ones, then makes it a candidate for later ones.

        Args:
            stored: one of the added keyframes. Call this once for each.
            linked: numbers of those that it is not compared with.

        Returns:
            The loops found.
        """
        keyframe = self._whole.of(stored)
        descriptors = self._descriptors(keyframe)
        alike = self._alike(descriptors)
        self._session.add(keyframe.row, descriptors)
        return self._loops(keyframe, alike, linked)

    def recognised(self, keyframe: MapKeyframe) -> tuple[PoseGraphEdge, ...]:
        """The loops of a keyframe, which is not added, with similar ones."""
        return self._loops(keyframe, self._alike(self._descriptors(keyframe)), ())

    def loops_near(
        self, child: StoredKeyframe, poses: Mapping[int, Float64], linked: Container[int]
    ) -> tuple[PoseGraphEdge, ...]:
        """Compares a keyframe with the nearest earlier ones.

        Args:
            child: one of the added keyframes.
            poses: T_map_camera [4, 4] of keyframes by their numbers, including this one.
            linked: numbers of those that it is not compared with.

        Returns:
            The loops found.
        """
        T_child = poses[child.row]
        earlier = [n for n in poses if self._is_earlier(n, child.row)]
        apart = se3.differences(np.array([poses[n] for n in earlier]).reshape(-1, 4, 4), T_child)
        near = [earlier[row] for row in np.argsort(apart, kind="stable") if apart[row] < _NEAR]
        unlinked = [n for n in near if n not in linked]
        expected = {n: se3.inverse(poses[n]) @ T_child for n in unlinked[:_NEAREST]}
        return self._compared(self._whole.of(child), expected) if expected else ()

    def _alike(self, descriptors: UInt8) -> list[Likeness]:
        return most_alike_first([*self._before.like(descriptors), *self._session.like(descriptors)])

    def _loops(
        self, keyframe: MapKeyframe, alike: Sequence[Likeness], linked: Container[int]
    ) -> tuple[PoseGraphEdge, ...]:
        candidates = [
            likeness.number
            for likeness in alike
            if self._is_earlier(likeness.number, keyframe.row) and likeness.matches >= _MIN_MATCHES
        ]
        unlinked = [number for number in candidates[:_MOST_ALIKE] if number not in linked]
        return self._compared(keyframe, dict.fromkeys(unlinked))

    def _compared(
        self, child: MapKeyframe, expected: Mapping[int, Float64 | None]
    ) -> tuple[PoseGraphEdge, ...]:
        """The loops of a keyframe with others, by number the poses that it is expected at."""
        edges = [
            loop_edge(self._whole.of(self.keyframes[n]), child, self._glue, self._config, T)
            for n, T in expected.items()
        ]
        return tuple(edge for edge in edges if edge is not None)

    def _is_earlier(self, parent: int, child: int) -> bool:
        """Whether the odometry has not already compared the two.

        It knows its latest keyframes, and none of a given map.
        """
        start = self.session_start if child >= self.session_start else 0
        return parent < max(start, child - self._config.odometry.window)

    def _of_view(self, keyframe: MapKeyframe, view: PackedView) -> StoredKeyframe:
        return StoredKeyframe.of_view(keyframe, view, self._config.refine.grid_step)

    def _remembered(self, stored: StoredKeyframe, keyframe: MapKeyframe) -> StoredKeyframe:
        # it is compared next
        self._whole.remember(stored, keyframe)
        return stored

    def _descriptors(self, keyframe: MapKeyframe) -> UInt8:
        """ORB descriptors [N, 32], strongest first."""
        described = self._orb.extract(keyframe.features.view)
        nothing = np.empty((0, 32), np.uint8)
        return np.asarray(described.descriptors, np.uint8) if len(described.uv) else nothing


def linked_to(child: int, edges: Iterable[PoseGraphEdge]) -> set[int]:
    """The parents of all edges to a keyframe."""
    return {edge.parent for edge in edges if edge.child == child}


def is_of_a_loop(edge: PoseGraphEdge, edges: Iterable[PoseGraphEdge]) -> bool:
    """Whether one of some edges is a loop between the same keyframes.

    The odometry's return to an anchor then measures the same images again: both together would
    count them twice.
    """
    ends = edge.parent, edge.child
    return any(e.origin is EdgeOrigin.LOOP and (e.parent, e.child) == ends for e in edges)
