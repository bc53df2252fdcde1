"""One session of the odometry: everything between a start, or a reset, and the next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.background import BackgroundThread
from rgbd_glue_ros.odometry.depth_diagnosis import summarise_depth
from rgbd_glue_ros.odometry.inertial import Inertial
from rgbd_glue_ros.odometry.keyframe import NewestKeyframe
from rgbd_glue_ros.odometry.keyframe_candidate import KeyframeCandidate, overlap
from rgbd_glue_ros.odometry.keyframe_map import KeyframeMap
from rgbd_glue_ros.odometry.motion_filter import MEMORY_S, Motion, PredictedMotion
from rgbd_glue_ros.odometry.own_parts_tracker import OwnPartsTracker
from rgbd_glue_ros.odometry.pose_covariance import is_known, unmeasured_part
from rgbd_glue_ros.odometry.pose_refinement import Basin, PoseProblem, corrected_motion
from rgbd_glue_ros.odometry.progress import LastPose, Progress
from rgbd_glue_ros.odometry.relocalisation import recognise, relocalise
from rgbd_glue_ros.odometry.repeated_images import LastDepth
from rgbd_glue_ros.odometry.self_calibration import SelfCalibration
from rgbd_glue_ros.odometry.tracked_pose import TrackedPose
from rgbd_glue_ros.odometry.tracking import Attempt, PoseFix, track
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.stopwatch import timed
from rgbd_glue_ros.types import (
    NANOSECONDS,
    Float64,
    ImuSamples,
    OdometryEstimate,
    RgbdFrame,
    TrackingState,
    View,
    stages,
)

# Between frames farther apart than this the twist says too little about the moment of one of them.
_TWIST_IS_CERTAIN_NS = NANOSECONDS // 10


class Session:
    """Gives frames poses in one track frame, and keeps all that is known from one to the next.

    Attributes:
        inertial: what an IMU adds to the images.
        keyframes: with the edges between them and their drift.
        calibration: what was learnt about the camera.
    """

    def __init__(self, glue: Glue, background: BackgroundThread, config: Config) -> None:
        self._glue = glue
        self._background = background
        self._config = config
        self._progress = Progress()
        self._candidate: KeyframeCandidate | None = None
        self._last_depth: LastDepth | None = None
        self._own_parts = OwnPartsTracker(background, config.odometry)
        self.inertial = Inertial()
        self.keyframes = KeyframeMap(glue, background, config)
        self.calibration = SelfCalibration(background, config)

    def reconfigure(self, config: Config) -> None:
        """Uses other parameters from the next frame on, with a reconfigured ``Glue``."""
        self._config = config
        self._own_parts.reconfigure(config.odometry)
        self.keyframes.reconfigure(config)
        self.calibration.reconfigure(config)

    @property
    def state(self) -> TrackingState:
        """The state after the last frame."""
        return self._progress.state

    def add_imu(self, samples: ImuSamples) -> None:
        """Adds samples of an IMU, in the axes of the camera's optical frame."""
        self.inertial = self.inertial.with_samples(samples)

    def track(self, frame: RgbdFrame, T_guess_camera: Float64 | None) -> OdometryEstimate:
        """Registers a frame, as ``Odometry.track`` does."""
        self.update_map()
        self._progress = self._progress.with_frame(frame.stamp_ns, T_guess_camera)
        self.inertial = self.inertial.at_frame(frame.stamp_ns)
        last, predicted = self._progress.last, self._predict(frame.stamp_ns)
        (whole, view), preparation_ms = timed(self._prepare, frame, predicted)
        if (repeated := self._progress.repeated(frame.stamp_ns, view)) is not None:
            return replace(repeated, stages_ms={stages.PREPARATION: preparation_ms})
        if last is None or predicted is None:
            estimate = self._start(frame.stamp_ns, view)
        else:
            attempt = self._find_pose(view, last, predicted)
            if attempt.fix is None:
                estimate = self._miss(attempt, last.motion, frame.stamp_ns)
            else:
                estimate = self._accept(attempt, attempt.fix, last, predicted, whole)
        if estimate.T_odom_camera is None:
            estimate = replace(estimate, depth=summarise_depth(frame.depth, self._config.camera))
        return replace(
            estimate, stages_ms={stages.PREPARATION: preparation_ms, **estimate.stages_ms}
        )

    def update_map(self) -> bool:
        """Makes a keyframe of the frame tracked last, if it is due; whether it did."""
        candidate, self._candidate = self._candidate, None
        if candidate is None or not self.keyframes.add_if_due(candidate, self.calibration):
            return False
        if not is_known(candidate.pose.motion):
            self._progress = self._progress.at_own_keyframe()
        return True

    def _predict(self, stamp_ns: int) -> PredictedMotion | None:
        """The motion at a stamp, predicted without its images; None at the start."""
        last = self._progress.last
        if last is None:
            return None
        predicted = self.inertial.predicted(last.motion, stamp_ns, self._config.motion)
        return self._progress.guided(predicted)

    def _prepare(self, frame: RgbdFrame, predicted: PredictedMotion | None) -> tuple[View, View]:
        """The frame with its expected twist: all of it, and without parts of the robot."""
        if predicted is None:
            self.calibration.start(frame.frame_id)
        twist = np.zeros(6) if predicted is None else predicted.twist
        whole = self.calibration.prepare(frame, twist)
        self._last_depth = LastDepth.after(self._last_depth, whole, frame.stamp_ns)
        if self.state is TrackingState.TRACKING:
            whole = self._last_depth.dated(whole, frame.stamp_ns)
        return whole, self._own_parts.left_out(whole)

    def _find_pose(self, view: View, last: LastPose, predicted: PredictedMotion) -> Attempt:
        """Tracks a frame against the nearest keyframes; failing that, relocalises it."""
        references = self.keyframes.nearest(predicted.T_track_camera)
        model = self.keyframes.model_shown_by(references)
        config, refine_config = self._config.odometry, self.calibration.refine_config()
        problem = PoseProblem(
            model, view, refine_config, predicted=predicted, basin=Basin.of(config)
        )
        acceptance = Acceptance.of(config)
        is_lost = self.state is TrackingState.LOST
        if self._progress.is_after_gap or (is_lost and predicted.elapsed_s > MEMORY_S):
            acceptance = acceptance.sceptical()
        elif is_lost:
            acceptance = acceptance.stricter()
        tracked = track(
            problem,
            references[0],
            last,
            self._glue,
            self._background,
            acceptance,
            config.prior_radius,
        )
        self.keyframes.finish_revisit()
        if tracked.fix is None:
            return self._relocalise(tracked, problem)
        return self._recognise(tracked, tracked.fix, problem)

    def _recognise(self, tracked: Attempt, fix: PoseFix, problem: PoseProblem) -> Attempt:
        """Continues in an earlier component of the map once a tracked frame shows a part of it.

        The component that the frame was tracked in joins it, unless the frame itself, as one that
        was tracked from a bare wall, does not know where in that component it is.
        """
        newest, earlier = self.keyframes.newest(), self.keyframes.next_to_recognise()
        if newest is None or earlier is None:
            return tracked
        acceptance, errors = Acceptance.of(self._config.odometry), self.calibration.pose_errors()
        recognition = recognise(tracked, fix, earlier, problem, self._glue, acceptance, errors)
        if recognition is None:
            return tracked
        count = errors.residuals_per_independent_one
        if not unmeasured_part(fix.estimate.refinement, count).any():
            self.keyframes.join(newest, earlier, recognition.T_shift, recognition.covariance)
        return recognition.attempt

    def _relocalise(self, tracked: Attempt, problem: PoseProblem) -> Attempt:
        """Searches for a frame that tracking has lost near other keyframes."""
        acceptance = Acceptance.of(self._config.odometry)
        # consecutive poses never jump: a frame without a pose announces a jump
        if self.state is not TrackingState.LOST:
            acceptance = acceptance.without_jumps()
        keyframes = self.keyframes.in_turn(self._progress.frames_missed)
        relocalised, ms = timed(
            relocalise, tracked.features, keyframes, problem, self._glue, acceptance
        )
        attempt = tracked if relocalised is None else relocalised
        stages_ms = {**tracked.registration.stages_ms, stages.RELOCALISATION: ms}
        return replace(attempt, registration=replace(attempt.registration, stages_ms=stages_ms))

    def _accept(
        self,
        attempt: Attempt,
        fix: PoseFix,
        last: LastPose,
        predicted: PredictedMotion,
        whole: View,
    ) -> OdometryEstimate:
        """Applies a pose to the motion, the drift, the map, and what is learnt about the camera.

        Args:
            attempt: that found the pose.
            fix: the pose.
            last: the last frame with a pose.
            predicted: the motion at this frame, predicted without it.
            whole: the frame with parts of the robot.
        """
        before = last.motion
        if fix.T_shift is not None:
            predicted, before = predicted.shifted(fix.T_shift), before.shifted(fix.T_shift)
            self.keyframes.shift_track(fix.T_shift, fix.reference)
            self._forget_earlier_poses()
        else:
            if not self.keyframes.leads_to(fix.reference):
                predicted = predicted.found_at(fix.estimate.T_track_camera)
                before = predicted
            self.keyframes.jump_to(fix.reference)
        count = self._config.refine.residuals_per_independent_one
        if not is_known(last.motion):
            part = unmeasured_part(fix.estimate.refinement, count)
            predicted = predicted.decoupled(part).slowed(part)
        motion = corrected_motion(predicted, fix.estimate, count)
        self.inertial = self.inertial.after_pose(motion.stamp_ns, fix.estimate, count)
        self.keyframes.advance_correction(before.T_track_camera, motion.T_track_camera)
        errors, acceptance = self.calibration.pose_errors(), Acceptance.of(self._config.odometry)
        pose = TrackedPose.of(fix, motion, predicted, errors, acceptance)
        # with its pose known, the twist of the frame is known better than its prediction
        view = replace(attempt.features.view, twist=motion.twist)
        knows_twist = motion.stamp_ns - before.stamp_ns <= _TWIST_IS_CERTAIN_NS
        if knows_twist:
            self.keyframes.set_velocity_at_start(before, motion)
        self.calibration.learn_from(fix, view, motion.T_track_camera, twist_is_certain=knows_twist)
        self._own_parts.compare(replace(whole, twist=motion.twist), motion.T_track_camera)
        overlapping = overlap(view, fix.estimate.refinement, self._config.refine)
        features = replace(attempt.features, view=view)
        self._candidate = KeyframeCandidate(pose, features, overlapping)
        estimate = replace(
            pose.estimate(self.keyframes.drift),
            registration=attempt.registration,
            stages_ms=attempt.stages_ms,
        )
        self._progress = self._progress.with_pose(motion, view, estimate, fix.alternative)
        return estimate

    def _start(self, stamp_ns: int, view: View) -> OdometryEstimate:
        """The first frame that shows enough becomes the origin of the track frame."""
        features = self._glue.extract(view)
        model = self.keyframes.model_if_enough(features)
        if model is None:
            return OdometryEstimate(stamp_ns, self.state)
        return self._start_at(self.keyframes.start(stamp_ns, features, model), features.stages_ms)

    def _miss(self, attempt: Attempt, last: Motion, stamp_ns: int) -> OdometryEstimate:
        """No pose for this frame; after enough such frames, a restart at the last pose."""
        features = attempt.features
        model = self.keyframes.model_if_enough(features)
        self._progress = self._progress.with_miss(shows_enough=model is not None)
        missed = OdometryEstimate(
            stamp_ns, self.state, registration=attempt.registration, stages_ms=attempt.stages_ms
        )
        # a covered camera may still return to a known place
        if model is None or not self._progress.needs_restart(stamp_ns, self._config.odometry):
            return missed
        anew = self.keyframes.start_anew(stamp_ns, last, features, model)
        return self._start_at(anew, attempt.stages_ms)

    def _start_at(self, keyframe: NewestKeyframe, stages_ms: dict[str, float]) -> OdometryEstimate:
        """Goes on from the pose of a keyframe, and reports it."""
        self._forget_earlier_poses()
        motion = Motion.start(keyframe.stamp_ns, keyframe.T_track_camera)
        estimate = OdometryEstimate(
            keyframe.stamp_ns,
            TrackingState.TRACKING,
            *self.keyframes.drift.pose_in_odom(keyframe.T_track_camera, keyframe.covariance),
            is_keyframe=True,
            keyframe_id=keyframe.number,
            stages_ms=stages_ms,
        )
        self._progress = self._progress.with_pose(motion, keyframe.features.view, estimate)
        return estimate

    def _forget_earlier_poses(self) -> None:
        """Continues with poses that do not go on from the last one, by an unknown motion."""
        self._own_parts.start_anew()
        self.inertial = self.inertial.start_anew()
