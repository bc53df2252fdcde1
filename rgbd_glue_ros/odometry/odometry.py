"""Keyframe odometry: gives every frame a pose, or reports that it has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.closing import Closing, uninterrupted
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.acceptance import sceptical
from rgbd_glue_ros.odometry.background import BackgroundThread
from rgbd_glue_ros.odometry.contradiction import doubt
from rgbd_glue_ros.odometry.depth_diagnosis import summarise_depth
from rgbd_glue_ros.odometry.inertial import Inertial
from rgbd_glue_ros.odometry.keyframe_edges import timing_covariance, tracked_covariance
from rgbd_glue_ros.odometry.keyframe_map import KeyframeCandidate, KeyframeMap, overlap
from rgbd_glue_ros.odometry.keyframes import RecentKeyframe
from rgbd_glue_ros.odometry.motion_filter import Motion, PredictedMotion
from rgbd_glue_ros.odometry.pose_refinement import PoseProblem, corrected_motion
from rgbd_glue_ros.odometry.progress import LastPose, Progress
from rgbd_glue_ros.odometry.relocalisation import relocalise
from rgbd_glue_ros.odometry.self_calibration import SelfCalibration
from rgbd_glue_ros.odometry.tracking import Attempt, PoseFix, track
from rgbd_glue_ros.parameters import Config, load_preset
from rgbd_glue_ros.refinement.model import blend
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.stopwatch import timed
from rgbd_glue_ros.types import (
    NANOSECONDS,
    Float64,
    ImuCalibration,
    ImuSamples,
    OdometryEstimate,
    PoseGraphEdge,
    RgbdFrame,
    TrackingState,
    View,
)
from rgbd_glue_ros.types.checks import check_guess

# Between frames farther apart than this the twist says too little about the moment of one of them.
_TWIST_IS_CERTAIN_NS = NANOSECONDS // 10


class Odometry(Closing):
    """Turns RGB-D frames into poses T_odom_camera.

    Deterministic: the same frames and configuration give the same bits. Not thread-safe: call it
    from one thread; its own ends with ``close`` or a ``with``. By default it has the preset
    ``live`` and creates its ``Glue``. Ctrl-C interrupts it when a frame is done.
    """

    def __init__(self, config: Config | None = None, glue: Glue | None = None) -> None:
        self._config = config or load_preset("live")
        self._glue = glue or Glue(self._config)
        self._background = BackgroundThread()
        self.reset()

    def close(self) -> None:
        """Ends the background thread; no frame can be tracked after that."""
        self._background.close()

    def reconfigure(self, config: Config) -> None:
        """Uses other parameters from the next frame on; fixed ones must be unchanged."""
        self._config = config
        self._glue.reconfigure(config)
        self._map.reconfigure(config)
        self._calibration.reconfigure(config)

    def reset(self) -> None:
        """Forgets everything; the next frame starts a new odom frame at the identity."""
        self._progress = Progress()
        self._map = KeyframeMap(self._glue, self._background, self._config)
        self._calibration = SelfCalibration(self._background, self._config)
        self._candidate: KeyframeCandidate | None = None
        self._inertial = Inertial()

    def add_imu(self, samples: ImuSamples) -> None:
        """Adds samples of an IMU, in the axes of the camera's optical frame; optional.

        Samples are used if they are added before ``track`` or ``process`` is called with the frame
        that they lead up to. For frames that they do not cover, motion is predicted without them.
        """
        self._inertial = self._inertial.with_samples(samples)

    @property
    def imu_calibration(self) -> ImuCalibration:
        """What was learnt about the IMU so far, and what it is used for."""
        return self._inertial.calibration

    def up(self, stamp_ns: int) -> Float64 | None:
        """The unit vector [3] away from the earth, in the optical frame; None if unknown."""
        return self._inertial.up(stamp_ns)

    @property
    def state(self) -> TrackingState:
        """The state after the last frame."""
        return self._progress.state

    def process(self, frame: RgbdFrame, T_guess_camera: Float64 | None = None) -> OdometryEstimate:
        """``track``, completed by ``update_map`` and ``new_edges``."""
        estimate = self.track(frame, T_guess_camera)
        became_keyframe, ms = timed(self.update_map)
        return replace(
            estimate,
            is_keyframe=became_keyframe or estimate.is_keyframe,
            edges=self.new_edges(),
            stages_ms={**estimate.stages_ms, "keyframe": ms},
        )

    @uninterrupted()
    def track(self, frame: RgbdFrame, T_guess_camera: Float64 | None = None) -> OdometryEstimate:
        """Registers a frame and returns its estimate.

        Args:
            frame: later than the previous one.
            T_guess_camera: float64 [4, 4], the camera's pose by another odometry, in its own fixed
                frame; None if there is none. The search starts from its motion since the last pose.

        Returns:
            The estimate; ``update_map`` decides whether the frame becomes a keyframe, except for
            one at which the odometry starts or restarts, which already is one.

        Raises:
            InputError: the frame is not later than the previous one, the guess is not a pose, or
                the odometry was closed. An image that shows nothing gives an estimate without a
                pose.
        """
        self._background.check_open()
        if T_guess_camera is not None:
            check_guess(T_guess_camera)
        self.update_map()
        self._progress = self._progress.with_frame(frame.stamp_ns)
        self._inertial = self._inertial.at_frame(frame.stamp_ns)
        last, predicted = self._progress.last, self._predict(frame.stamp_ns, T_guess_camera)
        view, preparation_ms = timed(self._prepare, frame, predicted)
        if (repeated := self._progress.repeated(frame.stamp_ns, view)) is not None:
            return replace(repeated, stages_ms={"preparation": preparation_ms})
        if last is None or predicted is None:
            estimate = self._start(frame.stamp_ns, view)
        else:
            attempt = self._find_pose(view, last, predicted)
            if attempt.fix is None:
                estimate = self._miss(attempt, last.motion, frame.stamp_ns)
            else:
                estimate = self._accept(attempt, attempt.fix, last.motion, predicted)
        if estimate.T_odom_camera is None:
            estimate = replace(estimate, depth=summarise_depth(frame.depth, self._config.camera))
        else:
            self._progress = self._progress.with_estimate(estimate, T_guess_camera)
        return replace(estimate, stages_ms={"preparation": preparation_ms, **estimate.stages_ms})

    @uninterrupted()
    def update_map(self) -> bool:
        """Makes a keyframe of the frame tracked last, if it is due.

        This takes a while, and only the next frame's pose waits for it: call it after publishing
        the pose. Otherwise the next ``track`` calls it.

        Returns:
            Whether the frame became a keyframe.
        """
        candidate, self._candidate = self._candidate, None
        return candidate is not None and self._map.add_if_due(candidate, self._calibration)

    @property
    def newest_keyframe(self) -> RecentKeyframe | None:
        """The keyframe made last; None before the first."""
        return self._map.newest()

    def learnt_config(self) -> Config:
        """The parameters adapted to this camera: refinement and errors of poses."""
        return self._calibration.learnt_config()

    def new_edges(self) -> tuple[PoseGraphEdge, ...]:
        """The edges measured between keyframes since the last call.

        A keyframe's edge to the one that it was tracked from is available after ``update_map``;
        that to an anchor, after the next ``track``.
        """
        return self._map.take_edges()

    def _predict(self, stamp_ns: int, T_guess_camera: Float64 | None) -> PredictedMotion | None:
        """The motion at a stamp, predicted without its images; None at the start."""
        last, T_guess_last = self._progress.last, self._progress.T_guess_camera
        if last is None:
            return None
        predicted = self._inertial.predicted(last.motion, stamp_ns, self._config.motion)
        if T_guess_last is None or T_guess_camera is None:
            return predicted
        T_last_camera = se3.inverse(T_guess_last) @ T_guess_camera
        return replace(predicted, T_track_camera=last.motion.T_track_camera @ T_last_camera)

    def _prepare(self, frame: RgbdFrame, predicted: PredictedMotion | None) -> View:
        """The frame prepared for registration, with its expected twist."""
        if predicted is None:
            self._calibration.start(frame.frame_id)
        twist = np.zeros(6) if predicted is None else predicted.twist
        return self._calibration.prepare(frame, twist)

    def _find_pose(self, view: View, last: LastPose, predicted: PredictedMotion) -> Attempt:
        """Tracks a frame against the nearest keyframes; failing that, relocalises it."""
        references = self._map.nearest(predicted.T_track_camera)
        model = blend([keyframe.model for keyframe in references])
        problem = PoseProblem(model, view, self._calibration.refine_config(), predicted=predicted)
        config, is_lost = self._config.odometry, self.state is TrackingState.LOST
        asked = sceptical(config) if is_lost or self._progress.is_after_gap else config
        tracked = track(problem, references, last, self._glue, self._background, asked)
        self._map.finish_revisit()
        if tracked.fix is not None:
            return tracked
        keyframes = self._map.in_turn(self._progress.frames_missed)
        relocalised = relocalise(
            tracked.features, keyframes, problem, self._glue, config, is_lost=is_lost
        )
        return tracked if relocalised is None else relocalised

    def _accept(
        self, attempt: Attempt, fix: PoseFix, last: Motion, predicted: PredictedMotion
    ) -> OdometryEstimate:
        """Applies a pose to the motion, the drift, the calibration and the map."""
        if fix.T_shift is not None:
            predicted, last = predicted.shifted(fix.T_shift), last.shifted(fix.T_shift)
            self._map.shift_track(fix.T_shift)
        refine = self._config.refine
        motion = corrected_motion(predicted, fix.estimate, refine)
        self._inertial = self._inertial.after_pose(motion.stamp_ns, fix.estimate, refine)
        self._map.advance_correction(fix.reference, last.T_track_camera, motion.T_track_camera)
        learnt = self._calibration.learnt_config()
        said = corrected_motion(predicted, fix.estimate, learnt.refine)
        covariance = tracked_covariance(said, fix.reference, learnt.odometry) + doubt(
            fix.estimate.refinement, fix.alternative, predicted.reach_covariance(), learnt.odometry
        )
        # with its pose known, the twist of the frame is known better than its prediction
        view = replace(attempt.features.view, twist=motion.twist)
        self._progress = self._progress.with_pose(LastPose(motion, view, fix.alternative))
        is_certain = motion.stamp_ns - last.stamp_ns <= _TWIST_IS_CERTAIN_NS
        self._calibration.learn_from(fix, view, motion.T_track_camera, twist_is_certain=is_certain)
        self._candidate = KeyframeCandidate(
            motion.stamp_ns,
            motion.T_track_camera,
            covariance,
            timing_covariance(said, learnt.odometry),
            replace(attempt.features, view=view),
            fix.reference,
            overlap(view, fix.estimate.refinement, refine),
        )
        from_keyframe = covariance - fix.reference.covariance
        return OdometryEstimate(
            motion.stamp_ns,
            self.state,
            *self._map.pose_in_odom(motion.T_track_camera, covariance),
            motion.twist.copy(),
            motion.covariance[6:, 6:].copy(),
            keyframe_id=fix.reference.number,
            registration=attempt.registration,
            stages_ms={**attempt.features.stages_ms, **attempt.registration.stages_ms},
            covariance_from_keyframe=self._map.covariance_in_odom(from_keyframe),
        )

    def _start(self, stamp_ns: int, view: View) -> OdometryEstimate:
        """The first frame that shows enough becomes the origin of the track frame."""
        features = self._glue.extract(view)
        model = self._map.model_if_enough(features)
        if model is None:
            return OdometryEstimate(stamp_ns, self.state)
        return self._start_at(self._map.start(stamp_ns, features, model), features.stages_ms)

    def _miss(self, attempt: Attempt, last: Motion, stamp_ns: int) -> OdometryEstimate:
        """No pose for this frame; after enough such frames, a restart at the last pose."""
        features = attempt.features
        model = self._map.model_if_enough(features)
        self._progress = self._progress.with_miss(shows_enough=model is not None)
        missed = OdometryEstimate(
            stamp_ns, self.state, registration=attempt.registration, stages_ms=features.stages_ms
        )
        # a covered camera may still return to a known place
        is_time = self._progress.is_long_without_pose(stamp_ns, self._config.odometry)
        if model is None or not is_time:
            return missed
        anew = self._map.start_anew(stamp_ns, last, features, model)
        return self._start_at(anew, features.stages_ms)

    def _start_at(self, keyframe: RecentKeyframe, stages_ms: dict[str, float]) -> OdometryEstimate:
        """Restarts at the pose of a keyframe, and reports it."""
        self._calibration.start_anew()
        motion = Motion.start(keyframe.stamp_ns, keyframe.T_track_camera)
        self._progress = self._progress.with_pose(LastPose(motion, keyframe.features.view))
        return OdometryEstimate(
            keyframe.stamp_ns,
            self.state,
            *self._map.pose_in_odom(keyframe.T_track_camera, keyframe.covariance),
            is_keyframe=True,
            keyframe_id=keyframe.number,
            stages_ms=stages_ms,
        )
