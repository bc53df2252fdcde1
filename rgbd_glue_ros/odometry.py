"""Keyframe odometry: registers every frame against keyframes and keeps the tracking state."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from rgbd_glue_ros import se3
from rgbd_glue_ros.camera import grey, limit_depth, rectified
from rgbd_glue_ros.config import Config
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.features.geometric import Rough
from rgbd_glue_ros.glue import FrameFeatures, Glue
from rgbd_glue_ros.keyframes import Keyframe, Keyframes
from rgbd_glue_ros.model import Model, blend, model_of
from rgbd_glue_ros.motion import Motion
from rgbd_glue_ros.moving import still
from rgbd_glue_ros.refinement import COARSE_TO_FINE, Refinement, judge, refine
from rgbd_glue_ros.timing import Timing
from rgbd_glue_ros.types import (
    NANOSECONDS,
    Float64,
    OdometryEstimate,
    RegistrationResult,
    RegistrationStatus,
    RgbdFrame,
    TrackingState,
    View,
)

# The levels that poses are compared at, and those that the best is finished at, once the velocity
# that it implies is known: the images of a fast camera depend on that.
_COARSE, _FINE = COARSE_TO_FINE[:-1], COARSE_TO_FINE[-2:]
# Surfaces fill an image, but all its texture may be on somebody who walks through it: what the
# correlation of brightness counts beside the agreement of planes.
_TEXTURE = 0.3
# Between frames farther apart a velocity says too little of the moment of one to time it.
_STEADY_NS = NANOSECONDS // 10
# A hand-held camera or a robot indoors: how far a lost pose may be off after a second.
_LOST_SPREAD = np.diag([1.0, 1.0, 1.0, 0.5, 0.5, 0.5]) ** 2
# The first pose is exact by definition; filters need a covariance that is not singular.
_ORIGIN_COVARIANCE = np.eye(6) * 1e-8


@dataclass(frozen=True)
class _Fix:
    """A pose found for a frame, and the evidence for it.

    ``covariance`` is that of the pose relative to the keyframe ``reference``, perturbation on the
    left, odom frame; ``model`` is what the pose was refined against.
    """

    T_odom_camera: Float64
    covariance: Float64
    reference: Keyframe
    registration: RegistrationResult
    refinement: Refinement
    model: Model


class Odometry:
    """Turns RGB-D frames into poses T_odom_camera.

    Deterministic: the same frames and configuration give the same bits. Not thread-safe: one
    thread calls ``process``.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._glue = Glue(config)
        self._beside = ThreadPoolExecutor(1, thread_name_prefix="beside")
        self.reset()

    def reconfigure(self, config: Config) -> None:
        """Goes on by other parameters, of which ``config.fixed_because`` says none is fixed."""
        self._config = config
        self._glue.reconfigure(config)

    def reset(self) -> None:
        """Forgets everything; the next frame starts a new odom frame at the identity."""
        self.state = TrackingState.INITIALIZING
        self._keyframes = Keyframes(self._config.odometry.keyframes)
        self._motion: Motion | None = None
        self._timing = _at_once(Timing.start(self._config.timing, ""))
        self._last_stamp_ns: int | None = None
        self._missed = 0
        self._T_guess_last: Float64 | None = None

    def process(self, frame: RgbdFrame, T_guess_camera: Float64 | None = None) -> OdometryEstimate:
        """Registers a frame and returns what is known after it.

        Args:
            frame: later than the one before.
            T_guess_camera: float64 [4, 4], the camera's pose by another odometry, in a fixed frame
                of its own; None if there is none. Its motion since the last pose is where the
                search starts.

        Raises:
            InputError: the frame is not later than the one before. Nothing else raises: an image
                that shows nothing gives an estimate without a pose.
        """
        estimate = self._process(frame, T_guess_camera)
        if estimate.T_odom_camera is not None:
            self._T_guess_last = T_guess_camera
        return estimate

    def _process(self, frame: RgbdFrame, T_guess_camera: Float64 | None) -> OdometryEstimate:
        start = perf_counter()
        if self._last_stamp_ns is not None and frame.stamp_ns <= self._last_stamp_ns:
            raise InputError(
                f"frame at {frame.stamp_ns} ns",
                f"not later than the frame before, at {self._last_stamp_ns} ns",
                "leave it out, or call reset() when time starts again",
            )
        self._last_stamp_ns = frame.stamp_ns
        predicted = self._predicted(frame.stamp_ns, T_guess_camera)
        view = self._view(frame, predicted)
        prepared = perf_counter()
        features = self._glue.extract(view)
        stages = {"preparation": (prepared - start) * 1e3, **features.stages_ms}
        if self._motion is None or predicted is None:
            return self._begin(frame.stamp_ns, features, stages)
        tracked = self._track(features, self._motion, predicted)
        if isinstance(tracked, _Fix):
            return self._accept(predicted, features, tracked, stages)
        recovered = self._recover(features, self._motion, predicted)
        if recovered is not None:
            return self._accept(predicted, features, recovered, stages)
        missed = OdometryEstimate(
            frame.stamp_ns, TrackingState.LOST, registration=tracked, stages_ms=stages
        )
        return self._miss(self._motion, features, missed)

    def _predicted(self, stamp_ns: int, T_guess_camera: Float64 | None) -> Motion | None:
        """The motion at a stamp as far as it is known before the images are; None at the start."""
        if self._motion is None:
            return None
        predicted = self._motion.predicted(stamp_ns, self._config.motion)
        if self._T_guess_last is None or T_guess_camera is None:
            return predicted
        step = se3.inverse(self._T_guess_last) @ T_guess_camera
        return replace(predicted, T_odom_camera=self._motion.T_odom_camera @ step)

    def _view(self, frame: RgbdFrame, predicted: Motion | None) -> View:
        """The frame without distortion, its depth in range, and how it was taken."""
        frame = rectified(frame)
        depth = limit_depth(frame.depth, self._config.camera)
        if predicted is None:
            self._timing = _at_once(Timing.start(self._config.timing, frame.frame_id))
        timing = self._timing.result()
        velocity = np.zeros(6) if predicted is None else predicted.velocity
        delay = frame.depth_delay_ns / NANOSECONDS - timing.depth_latency
        return View(grey(frame.color), depth, frame.intrinsics, velocity, timing.readout, delay)

    def _track(
        self, features: FrameFeatures, last: Motion, predicted: Motion
    ) -> _Fix | RegistrationResult:
        """Registers against the nearest keyframe and refines against the nearest few.

        Returns:
            A pose, or the registration that says why there is none.
        """
        odometry, T_predicted = self._config.odometry, predicted.T_odom_camera
        references = self._references(T_predicted)
        reference = references[0]
        prior = None
        if odometry.prior_radius > 0:
            T_reference_predicted = se3.inverse(reference.T_odom_camera) @ T_predicted
            prior = Rough(T_reference_predicted, odometry.prior_radius)
        prediction = self._beside.submit(self._try, T_predicted, references, features.view, prior)
        result = self._glue.register(features, reference.features, prior)
        start = perf_counter()
        model, best = prediction.result()
        if result.T_target_source is not None:
            found = reference.T_odom_camera @ result.T_target_source
            best = self._better(best, found, model, features.view)
        if best is not None:
            velocity = _corrected(predicted, self._fix(reference, result, best, model)).velocity
            best = self._finished(best, model, features.view, velocity)
        result.stages_ms["refinement"] = (perf_counter() - start) * 1e3
        if best is None:
            return result
        if not self._believable(best, best.planes_visible) or not (
            last.reaches(best.T_model_source, predicted) or self._certain(best)
        ):
            return result.refused(RegistrationStatus.INCONSISTENT)
        return self._fix(reference, result, best, model)

    def _references(self, T_odom_camera: Float64) -> list[Keyframe]:
        """The keyframes that a frame there is compared with, the nearest first."""
        odometry = self._config.odometry
        return self._keyframes.nearest(T_odom_camera, odometry.window)[: odometry.references]

    def _try(
        self, predicted: Float64, references: list[Keyframe], view: View, prior: Rough | None
    ) -> tuple[Model, Refinement | None]:
        """What to refine against, and the refinement from the prediction, if that is a prior."""
        model = blend([keyframe.model for keyframe in references])
        if prior is None:
            return model, None
        return model, refine(predicted, model, view, self._config.refine, _COARSE)

    def _finished(
        self, coarse: Refinement, model: Model, view: View, velocity: Float64
    ) -> Refinement:
        """Refines further under the velocity that the frame had; what was, if that fails."""
        config, T = self._config.refine, coarse.T_model_source
        finished = refine(T, model, replace(view, twist=velocity), config, _FINE)
        if self._believable(finished, finished.planes_visible):
            return finished
        return judge(T, model, view, config)

    def _better(self, best: Refinement | None, T: Float64, model: Model, view: View) -> Refinement:
        """The best refinement so far, or, where T is far from it, that from T if it fits better."""
        if best is not None and not self._far(best, T):
            return best
        found = refine(T, model, view, self._config.refine, _COARSE)
        return found if best is None else max((found, best), key=_support)

    def _recover(self, features: FrameFeatures, last: Motion, predicted: Motion) -> _Fix | None:
        """Looks for the frame near a few keyframes, without a prior and more sceptically.

        The latest come first; while the camera stays lost, frame by frame all others. Planes that
        are hidden count as well: somebody before the camera is no proof of a place.
        """
        odometry = self._config.odometry
        for keyframe in self._keyframes.in_turn(odometry.recovery_attempts, self._missed):
            result = self._glue.register(features, keyframe.features)
            if (
                result.T_target_source is None
                or len(result.visual_inliers) < odometry.recovery_inliers
            ):
                continue
            T = keyframe.T_odom_camera @ result.T_target_source
            refined = refine(T, keyframe.model, features.view, self._config.refine)
            if (
                self._believable(refined, refined.planes_seen)
                and refined.correlation >= odometry.pixel_correlation
                and (last.reaches(refined.T_model_source, predicted) or self._certain(refined))
            ):
                return self._fix(keyframe, result, refined, keyframe.model)
        return None

    def _fix(
        self, reference: Keyframe, result: RegistrationResult, refined: Refinement, model: Model
    ) -> _Fix:
        information = refined.information / self._config.refine.correlation
        covariance = np.asarray(
            np.linalg.inv(information + np.linalg.inv(_LOST_SPREAD)), np.float64
        )
        return _Fix(refined.T_model_source, covariance, reference, result, refined, model)

    def _far(self, found: Refinement, T_other: Float64) -> bool:
        odometry = self._config.odometry
        T = se3.inverse(found.T_model_source) @ T_other
        return bool(
            np.linalg.norm(T[:3, 3]) > odometry.surprise_translation
            or se3.rotation_angle(T) > odometry.surprise_rotation
        )

    def _believable(self, found: Refinement, asked: int) -> bool:
        """Whether planes or pixels speak for the pose and the planes do not speak against it.

        ``asked`` are the planes of which a part has to agree.
        """
        odometry = self._config.odometry
        enough = asked >= odometry.min_planes
        agreement = found.planes_agreeing / max(asked, 1)
        if enough and agreement < odometry.plane_agreement / 2:
            return False
        return (enough and agreement >= odometry.plane_agreement) or (
            found.pixels_seen >= odometry.min_pixels
            and found.correlation >= odometry.pixel_correlation
        )

    def _certain(self, found: Refinement) -> bool:
        """Whether a pose is to be believed that a camera hardly gets to: stamps may be wrong.

        Planes and pixels must speak for it, those too that something may hide.
        """
        odometry = self._config.odometry
        return (
            found.planes_seen >= odometry.min_planes
            and found.plane_agreement >= odometry.plane_agreement
            and found.correlation >= odometry.pixel_correlation
        )

    def _begin(
        self, stamp_ns: int, features: FrameFeatures, stages: dict[str, float]
    ) -> OdometryEstimate:
        """The first frame that shows enough becomes the origin of the odom frame."""
        model = model_of(features.view, self._config.refine.grid_step)
        if len(model.planes.points) < self._config.odometry.min_planes:
            return OdometryEstimate(stamp_ns, self.state, stages_ms=stages)
        keyframe = self._keyframes.add(stamp_ns, np.eye(4), _ORIGIN_COVARIANCE, features, model)
        self._motion = Motion.start(stamp_ns, np.eye(4))
        self.state = TrackingState.TRACKING
        return OdometryEstimate(
            stamp_ns,
            self.state,
            keyframe.T_odom_camera,
            keyframe.covariance,
            is_keyframe=True,
            keyframe_id=keyframe.number,
            stages_ms=stages,
        )

    def _miss(
        self, motion: Motion, features: FrameFeatures, missed: OdometryEstimate
    ) -> OdometryEstimate:
        """No pose for this frame; after enough of them, a new start at the last one."""
        self.state = missed.state
        model = model_of(features.view, self._config.refine.grid_step)
        if len(model.planes.points) < self._config.odometry.min_planes:
            return missed  # a covered camera may yet come back to a place that is known
        self._missed += 1
        countdown = self._config.odometry.reset_countdown
        if countdown == 0 or self._missed < countdown:
            return missed
        stamp_ns = missed.stamp_ns
        seconds = (stamp_ns - motion.stamp_ns) / NANOSECONDS
        (last,) = self._keyframes.latest(1)
        adjoint = se3.adjoint(motion.T_odom_camera)
        covariance = last.covariance + adjoint @ (_LOST_SPREAD * seconds**2) @ adjoint.T
        self._keyframes.forget()
        keyframe = self._keyframes.add(stamp_ns, motion.T_odom_camera, covariance, features, model)
        self._motion = Motion.start(stamp_ns, motion.T_odom_camera)
        self.state = TrackingState.TRACKING
        self._missed = 0
        return OdometryEstimate(
            stamp_ns,
            self.state,
            keyframe.T_odom_camera,
            se3.pose_covariance(keyframe.T_odom_camera, covariance),
            is_keyframe=True,
            keyframe_id=keyframe.number,
            stages_ms=missed.stages_ms,
        )

    def _accept(
        self,
        predicted: Motion,
        features: FrameFeatures,
        fix: _Fix,
        stages: dict[str, float],
    ) -> OdometryEstimate:
        """Corrects the motion by the pose, and makes a keyframe where it is time."""
        motion = _corrected(predicted, fix)
        steady = self._motion is not None and (
            motion.stamp_ns - self._motion.stamp_ns <= _STEADY_NS
        )
        self._motion = motion
        self._missed = 0
        self.state = TrackingState.TRACKING
        T = motion.T_odom_camera
        covariance = fix.reference.covariance + self._relative_covariance(motion, fix.reference)
        # now that the frame has a pose, its velocity is known better than it was before
        features = replace(features, view=replace(features.view, twist=motion.velocity))
        timing = self._timing.result()
        if steady and not timing.settled:
            # the next frame is the first to need it
            self._timing = self._beside.submit(
                timing.corrected,
                fix.refinement,
                fix.model,
                features.view,
                self._config.refine,
                self._config.timing,
            )
        start = perf_counter()
        keyframe = self._as_keyframe(features, fix)
        if keyframe is not None:
            self._keyframes.add(motion.stamp_ns, T, covariance, *keyframe)
        stages = {
            **stages,
            **fix.registration.stages_ms,
            "keyframe": (perf_counter() - start) * 1e3,
        }
        return OdometryEstimate(
            motion.stamp_ns,
            self.state,
            T,
            se3.pose_covariance(T, covariance),
            motion.velocity,
            motion.covariance[6:, 6:],
            keyframe is not None,
            fix.reference.number,
            fix.registration,
            stages,
        )

    def _relative_covariance(self, motion: Motion, reference: Keyframe) -> Float64:
        """Covariance [6, 6] of a pose relative to its keyframe, perturbation on the left.

        That of the motion, and what no residual shows: errors of time and of scale.
        """
        odometry = self._config.odometry
        T = motion.T_odom_camera
        distance = float(np.linalg.norm(T[:3, 3] - reference.T_odom_camera[:3, 3]))
        late = odometry.timing_error * np.linalg.norm(motion.velocity.reshape(2, 3), axis=1)
        translation = late[0] ** 2 + (odometry.scale_error * distance) ** 2
        unseen = np.diag([translation] * 3 + [late[1] ** 2] * 3)
        adjoint = se3.adjoint(T)
        covariance: Float64 = adjoint @ (motion.covariance[:6, :6] + unseen) @ adjoint.T
        return covariance

    def _as_keyframe(
        self, features: FrameFeatures, fix: _Fix
    ) -> tuple[FrameFeatures, Model] | None:
        """What a frame that should become a keyframe shows of the room; None if it should not."""
        odometry = self._config.odometry
        T = se3.inverse(fix.reference.T_odom_camera) @ fix.T_odom_camera
        way = max(
            float(np.linalg.norm(T[:3, 3])) / odometry.keyframe_translation,
            se3.rotation_angle(T) / odometry.keyframe_rotation,
        )
        if way < 1:
            return None
        near = self._references(fix.T_odom_camera)
        others = [(keyframe.features.view, keyframe.T_odom_camera) for keyframe in near]
        view = still(features.view, fix.T_odom_camera, others)
        anew = None if view is None else self._beside.submit(self._glue.seen_anew, features, view)
        model = model_of(features.view if view is None else view, self._config.refine.grid_step)
        if anew is not None:
            features = anew.result()
        if len(model.planes.points) < odometry.min_planes:
            return None
        # a blurred image is a poor keyframe: a sharper one is probably on its way
        blurred = 2 * len(model.pixels[0].points) < len(fix.reference.model.pixels[0].points)
        return None if blurred and way < 2 else (features, model)


def _at_once(timing: Timing) -> Future[Timing]:
    """What is known already, as what is being found out."""
    known: Future[Timing] = Future()
    known.set_result(timing)
    return known


def _corrected(predicted: Motion, fix: _Fix) -> Motion:
    to_body = se3.adjoint(se3.inverse(fix.T_odom_camera))
    return predicted.corrected(fix.T_odom_camera, to_body @ fix.covariance @ to_body.T)


def _support(found: Refinement) -> float:
    """How well planes and pixels agree, for choosing between two poses of one frame."""
    return found.plane_agreement + _TEXTURE * max(found.correlation, 0.0)
