"""Keyframes: frames with a pose that others are registered and refined against."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.surfaces import Surfaces
from rgbd_glue_ros.refinement.model import Model
from rgbd_glue_ros.registration.frame_features import Described, FrameFeatures
from rgbd_glue_ros.types import Float64

K = TypeVar("K", bound="Keyframe")
R = TypeVar("R", bound="RecentKeyframe")


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
        component: number of the first keyframe of its connected component of the map. Between
            components nothing was measured in some direction, as along a bare wall, or nothing at
            all, so that poses are compared with the keyframes of one component.
    """

    number: int
    stamp_ns: int
    T_track_camera: Float64
    covariance: Float64
    features: Described
    model: Model
    component: int

    def moved(self: K, T: Float64) -> K:
        """The keyframe elsewhere: its pose multiplied by T [4, 4] on the left."""
        return replace(
            self,
            T_track_camera=T @ self.T_track_camera,
            covariance=se3.transported_covariance(T, self.covariance),
            model=self.model.moved(T),
        )


@dataclass(frozen=True)
class RecentKeyframe(Keyframe):
    """A keyframe that tracking uses.

    Attributes:
        surfaces: what its depth shows, in the track frame.
    """

    surfaces: Surfaces

    @staticmethod
    def of(newest: NewestKeyframe, features: Described) -> RecentKeyframe:
        """What is kept of the newest keyframe once there is another."""
        return RecentKeyframe(
            newest.number,
            newest.stamp_ns,
            newest.T_track_camera,
            newest.covariance,
            features,
            newest.model,
            newest.component,
            newest.surfaces,
        )

    def moved(self: R, T: Float64) -> R:
        """The keyframe elsewhere: its pose multiplied by T [4, 4] on the left."""
        return replace(super().moved(T), surfaces=self.surfaces.moved(T))


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

    @staticmethod
    def of(keyframe: Keyframe, T_odom_track: Float64) -> Anchor:
        """What is kept of a keyframe that tracking leaves behind."""
        return Anchor(
            keyframe.number,
            keyframe.stamp_ns,
            keyframe.T_track_camera,
            keyframe.covariance,
            keyframe.features,
            keyframe.model,
            keyframe.component,
            T_odom_track,
        )

    @property
    def T_odom_camera(self) -> Float64:
        """The drift-corrected pose, float64 [4, 4]."""
        return self.T_odom_track @ self.T_track_camera
