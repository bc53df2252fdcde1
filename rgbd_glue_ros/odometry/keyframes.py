"""The keyframes that are kept: the latest, which are a window, and anchors that cover the room."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.keyframe import Anchor, K, Keyframe, NewestKeyframe, RecentKeyframe
from rgbd_glue_ros.odometry.surfaces import Surfaces
from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.refinement.model import Model
from rgbd_glue_ros.registration.frame_features import Described, FrameFeatures
from rgbd_glue_ros.types import Float64


class Keyframes:
    """The latest keyframes, and earlier ones that cover the room.

    The latest are the window that tracking chooses from. One that leaves it becomes an anchor,
    unless an earlier one is near, which has drifted less. If there are too many, the oldest anchor
    is dropped.
    """

    def __init__(
        self, config: OdometryConfig, without_images: Callable[[FrameFeatures], Described]
    ) -> None:
        """Has no keyframe yet.

        Args:
            config: how many are kept.
            without_images: gives what is kept of the features of a frame.
        """
        self._config = config
        self._without_images = without_images
        self._newest: NewestKeyframe | None = None
        self._earlier: deque[RecentKeyframe] = deque()
        self._anchors: deque[Anchor] = deque()
        self._count = 0

    def __len__(self) -> int:
        return len(self._anchors) + len(self._window())

    def __iter__(self) -> Iterator[Keyframe]:
        yield from self._anchors
        yield from self._window()

    def add(
        self,
        stamp_ns: int,
        T_track_camera: Float64,
        covariance: Float64,
        features: FrameFeatures,
        model: Model,
        T_odom_track: Float64,
        component: int | None,
    ) -> NewestKeyframe:
        """Makes a keyframe of a frame.

        Args:
            stamp_ns: of the frame.
            T_track_camera: as tracked, float64 [4, 4].
            covariance: float64 [6, 6] of it.
            features: of the frame.
            model: in its camera's frame.
            T_odom_track: the correction of all drift that is known, float64 [4, 4].
            component: that of the keyframe that its pose was measured from; None if it is the
                first of another.
        """
        self._drop_images()
        number, self._count = self._count, self._count + 1
        self._newest = NewestKeyframe(
            number,
            stamp_ns,
            T_track_camera,
            covariance,
            features,
            model.moved(T_track_camera),
            number if component is None else component,
            Surfaces.seen(features.view, T_track_camera),
        )
        if len(self._window()) > min(self._config.window, self._config.keyframes):
            self._leave(self._earlier.popleft(), T_odom_track)
        while len(self) > self._config.keyframes:
            self._anchors.popleft()
        return self._newest

    def rebuild_newest(self, newest: NewestKeyframe, features: FrameFeatures, model: Model) -> None:
        """Replaces what the newest keyframe shows; the model is in its camera's frame."""
        T = newest.T_track_camera
        surfaces = Surfaces.seen(features.view, T)
        self._newest = replace(newest, features=features, model=model.moved(T), surfaces=surfaces)

    def _window(self) -> list[RecentKeyframe]:
        return [*self._earlier, *([self._newest] if self._newest else [])]

    def _drop_images(self) -> None:
        """The newest keyframe becomes an earlier one."""
        newest, self._newest = self._newest, None
        if newest is not None:
            self._earlier.append(RecentKeyframe.of(newest, self._without_images(newest.features)))

    def _leave(self, keyframe: RecentKeyframe, T_odom_track: Float64) -> None:
        T_odom_camera = T_odom_track @ keyframe.T_track_camera
        if self.anchors(T_odom_camera, self._config.keyframe_spacing):
            return
        self._anchors.append(Anchor.of(keyframe, T_odom_track))

    def leave_window(self, T_odom_track: Float64) -> None:
        """Makes anchors of the whole window, so that tracking starts without it.

        Args:
            T_odom_track: the correction of all drift that is known, float64 [4, 4].
        """
        self._drop_images()
        while self._earlier:
            self._leave(self._earlier.popleft(), T_odom_track)

    def anchors(self, T_odom_camera: Float64, radius: float) -> list[Anchor]:
        """The anchors whose views are nearer to a pose than ``radius``, the earliest first.

        Args:
            T_odom_camera: drift-corrected pose of a camera, float64 [4, 4].
            radius: metres plus radians.
        """
        return [k for k in self._anchors if se3.difference(k.T_odom_camera, T_odom_camera) < radius]

    def newest(self) -> NewestKeyframe | None:
        """The keyframe made last; None before the first."""
        return self._newest

    @property
    def component(self) -> int:
        """The component of the newest keyframe; 0 before the first."""
        return 0 if self._newest is None else self._newest.component

    def is_tracked_from(self, keyframe: Keyframe) -> bool:
        """Whether the next frame is compared with a keyframe and those near it."""
        return not isinstance(keyframe, Anchor) and keyframe.component == self.component

    def of_earlier_components(self) -> list[Keyframe]:
        """The keyframes of components that began before that of the newest."""
        return [keyframe for keyframe in self if keyframe.component < self.component]

    def join(
        self,
        newest: NewestKeyframe,
        component: int,
        T_shift: Float64,
        covariance: Float64,
        T_odom_track: Float64,
    ) -> NewestKeyframe:
        """Moves the newest component to where it was recognised, and makes it a part of another.

        Args:
            newest: the newest keyframe.
            component: the other one.
            T_shift: float64 [4, 4], to be multiplied on the left of the poses of the newest.
            covariance: float64 [6, 6], of the newest keyframe's pose after that.
            T_odom_track: the correction of all drift of the other component, float64 [4, 4].

        Returns:
            The newest keyframe after that.
        """
        first = next(k for k in self if k.component == newest.component)

        def moved(keyframe: K) -> K:
            if keyframe.component != newest.component:
                return keyframe
            # as if it and the newest had nothing in common but the first
            since_first = keyframe.covariance + newest.covariance - 2 * first.covariance
            of_pose = covariance + se3.transported_covariance(T_shift, since_first)
            return replace(keyframe.moved(T_shift), covariance=of_pose, component=component)

        self._anchors = deque(
            each if (there := moved(each)) is each else replace(there, T_odom_track=T_odom_track)
            for each in self._anchors
        )
        self._earlier = deque(map(moved, self._earlier))
        self._newest = replace(moved(newest), covariance=covariance)
        return self._newest

    def latest(self, count: int) -> list[Keyframe]:
        """The last ``count`` keyframes, newest first."""
        return list(self)[::-1][:count]

    def in_turn(self, count: int, turn: int) -> list[Keyframe]:
        """``count`` of all keyframes, newest first and others at every turn, until all were used.

        Args:
            count: number of keyframes.
            turn: from 0, which starts with the newest.
        """
        newest_first = self.latest(len(self))
        start = turn * count % max(len(newest_first), 1)
        return (newest_first[start:] + newest_first[:start])[:count]

    def nearest(self, T_track_camera: Float64, component: int, count: int) -> list[RecentKeyframe]:
        """The window's ``count`` keyframes of a component whose views are nearest to a pose."""
        newest_first = [k for k in self._window()[::-1] if k.component == component]
        nearest_first = sorted(
            newest_first, key=lambda k: se3.difference(k.T_track_camera, T_track_camera)
        )
        return nearest_first[:count]
