"""Keyframes: frames with a pose that others are registered and refined against."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.surfaces import Surfaces
from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.refinement.model import Model
from rgbd_glue_ros.registration.frame_features import Described, FrameFeatures
from rgbd_glue_ros.types import Float64


@dataclass(frozen=True)
class Keyframe:
    """A frame that others are registered against.

    Attributes:
        number: counted from 0.
        stamp_ns: of the frame.
        T_track_camera: float64 [4, 4].
        covariance: float64 [6, 6] of the pose, perturbation on the left, track frame; without the
            error of its image's time, which does not accumulate in later poses.
        features: of the frame, that others are registered by.
        model: its planes and pixels, in the track frame.
    """

    number: int
    stamp_ns: int
    T_track_camera: Float64
    covariance: Float64
    features: Described
    model: Model


@dataclass(frozen=True)
class RecentKeyframe(Keyframe):
    """A keyframe that tracking uses.

    Attributes:
        surfaces: what its depth shows, in the track frame.
    """

    surfaces: Surfaces


@dataclass(frozen=True)
class NewestKeyframe(RecentKeyframe):
    """The keyframe made last, with its images; others keep none where features allow that."""

    features: FrameFeatures


@dataclass(frozen=True)
class Anchor(Keyframe):
    """A keyframe that tracking has left behind.

    Attributes:
        T_odom_track: float64 [4, 4], the correction of all drift of ``T_track_camera`` that was
            known when tracking left it.
    """

    T_odom_track: Float64

    @property
    def T_odom_camera(self) -> Float64:
        """The drift-corrected pose, float64 [4, 4]."""
        return self.T_odom_track @ self.T_track_camera


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
    ) -> NewestKeyframe:
        """Makes a keyframe of a frame.

        Args:
            stamp_ns: of the frame.
            T_track_camera: as tracked, float64 [4, 4].
            covariance: float64 [6, 6] of it.
            features: of the frame.
            model: in its camera's frame.
            T_odom_track: the correction of all drift that is known, float64 [4, 4].
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
            kept = {**vars(newest), "features": self._without_images(newest.features)}
            self._earlier.append(RecentKeyframe(**kept))

    def _leave(self, keyframe: RecentKeyframe, T_odom_track: Float64) -> None:
        T_odom_camera = T_odom_track @ keyframe.T_track_camera
        if self.anchors(T_odom_camera, self._config.keyframe_spacing):
            return
        kept = dict(vars(keyframe))
        del kept["surfaces"]
        self._anchors.append(Anchor(**kept, T_odom_track=T_odom_track))

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

    def nearest(self, T_track_camera: Float64) -> list[RecentKeyframe]:
        """The window, ordered by nearness of the view to a pose."""
        newest_first = reversed(self._window())
        return sorted(newest_first, key=lambda k: se3.difference(k.T_track_camera, T_track_camera))
