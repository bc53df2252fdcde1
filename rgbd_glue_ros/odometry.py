"""Keyframe odometry: registers every frame against keyframes and keeps the tracking state."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from rgbd_glue_ros import se3
from rgbd_glue_ros.camera import grey, limit_depth, rectified
from rgbd_glue_ros.config import Config
from rgbd_glue_ros.features.flow import TrackedView, track
from rgbd_glue_ros.features.fpfh import grid_points_and_normals
from rgbd_glue_ros.features.geometric import Rough
from rgbd_glue_ros.features.visual import View
from rgbd_glue_ros.glue import FrameFeatures, Glue
from rgbd_glue_ros.refinement import Planes, Refinement, Tracks, refine
from rgbd_glue_ros.types import (
    NANOSECONDS,
    Float64,
    OdometryEstimate,
    RegistrationResult,
    RegistrationStatus,
    RgbdFrame,
    TrackingState,
)


@dataclass(frozen=True)
class Keyframe:
    """A frame that others are registered against.

    Attributes:
        number: counted from 0.
        stamp_ns: of the frame.
        T_odom_camera: float64 [4, 4].
        covariance: float64 [6, 6] of the pose, perturbation on the left, odom frame.
        features: of the frame.
        planes: of the frame, in the odom frame.
        tracked: its keypoints.
    """

    number: int
    stamp_ns: int
    T_odom_camera: Float64
    covariance: Float64
    features: FrameFeatures
    planes: Planes
    tracked: TrackedView


@dataclass(frozen=True)
class _Fix:
    """A pose found for a frame, and the evidence for it."""

    T_odom_camera: Float64
    covariance: Float64
    reference: Keyframe
    registration: RegistrationResult
    refinement: Refinement | None


@dataclass(frozen=True)
class _Motion:
    """The last two poses with their stamps: what a constant velocity is read from."""

    stamp_ns: int
    T_odom_camera: Float64
    velocity: Float64

    def predict(self, stamp_ns: int) -> Float64:
        """T_odom_camera at a later stamp."""
        seconds = (stamp_ns - self.stamp_ns) / NANOSECONDS
        return self.T_odom_camera @ se3.exp(self.velocity * seconds)


class Odometry:
    """Turns RGB-D frames into poses T_odom_camera.

    Deterministic: the same frames and configuration give the same bits. Not thread-safe: one
    thread calls ``process``.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._glue = Glue(config)
        self.reset()

    def reset(self) -> None:
        """Forgets everything; the next frame starts a new odom frame at the identity."""
        self.state = TrackingState.INITIALIZING
        self.keyframes: deque[Keyframe] = deque(maxlen=self._config.odometry.keyframes)
        self._next_number = 0
        self._motion: _Motion | None = None

    def process(self, frame: RgbdFrame) -> OdometryEstimate:
        """Registers ``frame`` and returns what is known after it; never raises on image content."""
        start = perf_counter()
        frame = rectified(frame)
        depth = limit_depth(frame.depth, self._config.camera)
        view = View(grey(frame.color), depth, frame.intrinsics)
        features = self._glue.extract(view)
        if self._motion is None:
            keyframe = self._add_keyframe(frame.stamp_ns, np.eye(4), np.zeros((6, 6)), features)
            self.state = TrackingState.TRACKING
            self._motion = _Motion(frame.stamp_ns, keyframe.T_odom_camera, np.zeros(6))
            return OdometryEstimate(
                frame.stamp_ns, self.state, np.eye(4), np.zeros((6, 6)), is_keyframe=True
            )
        predicted = self._motion.predict(frame.stamp_ns)
        fix = self._locate(features, predicted)
        if fix is None:
            self.state = TrackingState.LOST
            return OdometryEstimate(frame.stamp_ns, self.state)
        seconds = (frame.stamp_ns - self._motion.stamp_ns) / NANOSECONDS
        velocity = se3.log(se3.inverse(self._motion.T_odom_camera) @ fix.T_odom_camera) / seconds
        self._motion = _Motion(frame.stamp_ns, fix.T_odom_camera, velocity)
        self.state = TrackingState.TRACKING
        is_keyframe = self._wants_keyframe(fix)
        if is_keyframe:
            self._add_keyframe(frame.stamp_ns, fix.T_odom_camera, fix.covariance, features)
        return OdometryEstimate(
            frame.stamp_ns,
            self.state,
            fix.T_odom_camera,
            fix.covariance,
            velocity,
            np.eye(6),
            is_keyframe,
            fix.reference.number,
            fix.registration,
            {
                **features.stages_ms,
                **fix.registration.stages_ms,
                "total": (perf_counter() - start) * 1e3,
            },
        )

    def _locate(self, features: FrameFeatures, predicted: Float64) -> _Fix | None:
        nearest = sorted(self.keyframes, key=lambda k: _distance(k.T_odom_camera, predicted))
        reference = nearest[0]
        T_reference_predicted = se3.inverse(reference.T_odom_camera) @ predicted
        prior = Rough(T_reference_predicted, self._config.odometry.prior_radius)
        result = self._glue.register(features, reference.features, prior)
        T = (
            predicted
            if result.T_target_source is None
            else reference.T_odom_camera @ result.T_target_source
        )
        t0 = perf_counter()
        references = nearest[: self._config.odometry.references]
        landmarks, uv = [], []
        for k in references:
            tracked = track(k.tracked, features.view, se3.inverse(k.T_odom_camera) @ T)
            _, points = k.tracked.keypoints
            landmarks.append(se3.transform(k.T_odom_camera, points[tracked.rows]))
            uv.append(tracked.uv)
        t1 = perf_counter()
        tracks = Tracks(np.concatenate(landmarks), np.concatenate(uv).astype(np.float64))
        planes = Planes(
            np.concatenate([k.planes.points for k in references]),
            np.concatenate([k.planes.normals for k in references]),
        )
        refined = refine(
            T, planes, tracks, features.view.depth, features.view.intrinsics, self._config.refine
        )
        result.stages_ms["tracks"] = (t1 - t0) * 1e3
        result.stages_ms["refine"] = (perf_counter() - t1) * 1e3
        return _Fix(
            refined.T_model_source, np.linalg.inv(refined.information), reference, result, refined
        )

    def _wants_keyframe(self, fix: _Fix) -> bool:
        config = self._config.odometry
        T = se3.inverse(fix.reference.T_odom_camera) @ fix.T_odom_camera
        return bool(
            np.linalg.norm(T[:3, 3]) > config.keyframe_translation
            or se3.rotation_angle(T) > config.keyframe_rotation
        )

    def _add_keyframe(
        self, stamp_ns: int, T: Float64, covariance: Float64, features: FrameFeatures
    ) -> Keyframe:
        view = features.view
        points, normals = grid_points_and_normals(
            view.depth, view.intrinsics, self._config.refine.grid_step
        )
        known = np.isfinite(points[..., 2])
        planes = Planes(se3.transform(T, points[known]), normals[known] @ T[:3, :3].T)
        keyframe = Keyframe(
            self._next_number,
            stamp_ns,
            T,
            covariance,
            features,
            planes,
            TrackedView(view, self._config.refine.keypoints),
        )
        self._next_number += 1
        self.keyframes.append(keyframe)
        return keyframe


def _distance(a: Float64, b: Float64) -> float:
    """How differently two cameras see a room: metres plus radians, as a room is metres wide."""
    T = se3.inverse(a) @ b
    return float(np.linalg.norm(T[:3, 3])) + se3.rotation_angle(T)
