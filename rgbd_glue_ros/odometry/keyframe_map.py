"""The keyframe map: the keyframes, the edges between them, and their drift."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.background import BackgroundThread
from rgbd_glue_ros.odometry.drift_correction import DriftCorrection, Revisit, revisit
from rgbd_glue_ros.odometry.keyframe import Anchor, Keyframe, NewestKeyframe, RecentKeyframe
from rgbd_glue_ros.odometry.keyframe_candidate import KeyframeCandidate
from rgbd_glue_ros.odometry.keyframe_edges import edge_from
from rgbd_glue_ros.odometry.keyframe_selection import shown_if_due, shows_enough
from rgbd_glue_ros.odometry.keyframes import Keyframes
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.odometry.pose_covariance import is_known
from rgbd_glue_ros.odometry.self_calibration import SelfCalibration
from rgbd_glue_ros.odometry.speeds import lost_covariance
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.model import LastBlend, Model, model_of
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.types import NANOSECONDS, EdgeOrigin, Float64, PoseGraphEdge

# The first pose is exact by definition; filters need a non-singular covariance.
_ORIGIN_COVARIANCE = np.eye(6) * 1e-8
# Anchors compared with a new keyframe, at most, while the next frame is tracked.
_ANCHORS_COMPARED = 3


class KeyframeMap:
    """Keyframes, the edges measured between them, and the drift that these show.

    The background thread compares a new keyframe with up to three anchors while the next frame is
    tracked; ``finish_revisit`` waits for it.
    """

    def __init__(self, glue: Glue, background: BackgroundThread, config: Config) -> None:
        self._glue = glue
        self._background = background
        self._config = config
        self._keyframes = Keyframes(config.odometry, glue.without_images)
        self._last_blend = LastBlend()
        self._edges: list[PoseGraphEdge] = []
        self._recognition_turn = 0
        self._drift = DriftCorrection.at(np.eye(4))
        self._revisit: Future[Revisit] | None = None

    def reconfigure(self, config: Config) -> None:
        """Sets other parameters; the keyframes remain."""
        self._config = config

    def newest(self) -> NewestKeyframe | None:
        """The keyframe made last; None before the first."""
        return self._keyframes.newest()

    def nearest(self, T_track_camera: Float64) -> list[RecentKeyframe]:
        """The keyframes that a frame at a pose is compared with, the nearest first."""
        component, count = self._keyframes.component, self._config.odometry.references
        return self._keyframes.nearest(T_track_camera, component, count)

    def model_shown_by(self, references: Sequence[Keyframe]) -> Model:
        """The planes and pixels that some of the keyframes show together, in the track frame."""
        return self._last_blend.of([keyframe.model for keyframe in references])

    def in_turn(self, turn: int) -> list[Keyframe]:
        """The keyframes for relocalisation: the latest first, then different ones at every turn."""
        return self._keyframes.in_turn(self._config.odometry.relocalisation_attempts, turn)

    @property
    def drift(self) -> DriftCorrection:
        """The correction of the drift, without that of a comparison that is not finished."""
        return self._drift

    def take_edges(self) -> tuple[PoseGraphEdge, ...]:
        """The edges measured since the last call."""
        edges, self._edges = tuple(self._edges), []
        return edges

    def model_if_enough(self, features: FrameFeatures) -> Model | None:
        """The planes and pixels of a frame; None if it shows too few planes for a keyframe."""
        model = model_of(features.view, self._config.refine.grid_step)
        return model if shows_enough(model, self._config.odometry) else None

    def start(self, stamp_ns: int, features: FrameFeatures, model: Model) -> NewestKeyframe:
        """Makes the first keyframe, which is the origin."""
        return self._add(stamp_ns, np.eye(4), _ORIGIN_COVARIANCE, features, model)

    def start_anew(
        self,
        stamp_ns: int,
        last_motion: Motion,
        features: FrameFeatures,
        model: Model,
    ) -> NewestKeyframe:
        """Tracks from a new keyframe at the last pose, where the camera is assumed to be.

        The keyframes before it become anchors: when the camera returns to one, the error of the
        assumption shows, and is corrected as drift.

        Args:
            stamp_ns: of its frame.
            last_motion: motion at the last frame with a pose.
            features: of its frame.
            model: of its frame.
        """
        (last,) = self._keyframes.latest(1)
        self._keyframes.leave_window(self._drift.T_odom_track_known)
        T_track_camera = last_motion.T_track_camera
        seconds = (stamp_ns - last_motion.stamp_ns) / NANOSECONDS
        since_lost = se3.transported_covariance(T_track_camera, lost_covariance(seconds))
        covariance = last.covariance + since_lost
        keyframe = self._add(stamp_ns, T_track_camera, covariance, features, model)
        edge = edge_from(last, keyframe.number, T_track_camera, since_lost, EdgeOrigin.ASSUMED)
        self._edges.append(edge)
        return keyframe

    def set_velocity_at_start(self, last: Motion, motion: Motion) -> None:
        """Rebuilds a keyframe that tracking has started at, once the next pose shows its velocity.

        Until then it seems to be at rest, so that a rolling shutter distorts it, and depth that is
        late shifts it, and all poses found from it.

        Args:
            last: the motion at the last pose; others than that of the start are left as they are.
            motion: that at the next pose, soon after it.
        """
        start = self._keyframes.newest()
        if start is None or start.stamp_ns != last.stamp_ns or start.features.view.twist.any():
            return
        seconds = (motion.stamp_ns - start.stamp_ns) / NANOSECONDS
        T_start_camera = se3.inverse(start.T_track_camera) @ motion.T_track_camera
        view = replace(start.features.view, twist=se3.log(T_start_camera) / seconds)
        features = self._glue.with_other_depth(start.features, view)
        self._keyframes.rebuild_newest(
            start, features, model_of(view, self._config.refine.grid_step)
        )

    def add_if_due(self, candidate: KeyframeCandidate, calibration: SelfCalibration) -> bool:
        """Makes a keyframe of a frame that is far enough from its reference and shows enough.

        Args:
            candidate: the frame.
            calibration: determines how the keyframe is refined on an anchor.

        Returns:
            Whether the frame became a keyframe.
        """
        shown = shown_if_due(candidate, self._keyframes, self._glue, self._background, self._config)
        if shown is None:
            return False
        pose = candidate.pose
        T, stamp_ns = pose.T_track_camera, pose.motion.stamp_ns
        # a keyframe with a wrong time is off, and what is tracked from it is off by the opposite
        covariance = pose.covariance - pose.timing_covariance
        component = pose.reference.component if is_known(pose.motion) else None
        keyframe = self._add(stamp_ns, T, covariance, *shown, component)
        relative = pose.covariance_from_keyframe
        self._edges.append(edge_from(pose.reference, keyframe.number, T, relative))
        self._compare_with_anchors(keyframe, calibration)
        return True

    def finish_revisit(self) -> None:
        """Applies what a comparison with anchors has measured, if there was one; waits for it."""
        if self._revisit is None:
            return
        job, self._revisit = self._revisit, None
        found = self._background.result(job)
        self._edges.extend(found.edges)
        self._drift = replace(self._drift, T_odom_track_known=found.T_odom_track_known)

    def next_to_recognise(self) -> Keyframe | None:
        """A keyframe of a component that began before the newest, another one at every call."""
        keyframes = self._keyframes.of_earlier_components()
        if not keyframes:
            return None
        self._recognition_turn = (self._recognition_turn + 1) % len(keyframes)
        return keyframes[::-1][self._recognition_turn]

    def join(
        self, newest: NewestKeyframe, keyframe: Keyframe, T_shift: Float64, covariance: Float64
    ) -> None:
        """Moves the newest component to where a keyframe of another one shows the same.

        Args:
            newest: the newest keyframe.
            keyframe: that of the other component.
            T_shift: float64 [4, 4], to be multiplied on the left of poses of the newest component.
            covariance: float64 [6, 6] of the newest keyframe's pose after that, given the pose of
                ``keyframe``.
        """
        known = self._known_drift_of(keyframe)
        of_newest = keyframe.covariance + covariance
        joined = self._keyframes.join(newest, keyframe.component, T_shift, of_newest, known)
        T = joined.T_track_camera
        self._edges.append(edge_from(keyframe, joined.number, T, covariance, EdgeOrigin.REVISIT))

    def leads_to(self, keyframe: Keyframe) -> bool:
        """Whether the way from the newest keyframe to this one was measured."""
        return keyframe.component == self._keyframes.component

    def jump_to(self, reference: Keyframe) -> None:
        """Continues where a pose was found from a keyframe: an anchor has a drift of its own."""
        if isinstance(reference, Anchor):
            self._drift = DriftCorrection.at(self._known_drift_of(reference))

    def advance_correction(self, T_before: Float64, T_now: Float64) -> None:
        """Moves the correction towards that of all known drift, according to the camera's motion.

        Args:
            T_before: T_track_camera of the previous pose, float64 [4, 4].
            T_now: T_track_camera of this pose.
        """
        self._drift = self._drift.advanced(T_before, T_now, self._config.odometry.drift_rate)

    def shift_track(self, T_shift: Float64, reference: Keyframe) -> None:
        """Continues with shifted tracked poses, without a jump of the published ones.

        Args:
            T_shift: float64 [4, 4], multiplied on the left of tracked poses from now on.
            reference: keyframe that the shifted pose was found from.
        """
        drift = self._drift.after_shift(T_shift)
        self._drift = replace(drift, T_odom_track_known=self._known_drift_of(reference))

    def _known_drift_of(self, keyframe: Keyframe) -> Float64:
        """The correction of all known drift of a keyframe's pose, T_odom_track [4, 4]."""
        if isinstance(keyframe, Anchor):
            return keyframe.T_odom_track
        return self._drift.T_odom_track_known

    def _add(
        self,
        stamp_ns: int,
        T_track_camera: Float64,
        covariance: Float64,
        features: FrameFeatures,
        model: Model,
        component: int | None = None,
    ) -> NewestKeyframe:
        T_odom_track = self._drift.T_odom_track_known
        return self._keyframes.add(
            stamp_ns, T_track_camera, covariance, features, model, T_odom_track, component
        )

    def _compare_with_anchors(self, keyframe: NewestKeyframe, calibration: SelfCalibration) -> None:
        """Starts comparisons with anchors that saw the same part of the room."""
        T_odom_camera = self._drift.T_odom_track_known @ keyframe.T_track_camera
        radius = self._config.odometry.drift_radius
        anchors = self._keyframes.anchors(T_odom_camera, radius)[:_ANCHORS_COMPARED]
        if anchors:
            self._revisit = self._background.submit(
                revisit,
                keyframe,
                anchors,
                self._drift.T_odom_track_known,
                calibration.refine_config(),
                Acceptance.of(self._config.odometry),
                calibration.pose_errors(),
            )
