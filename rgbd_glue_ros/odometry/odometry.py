"""Keyframe odometry: registers every frame against keyframes and keeps the tracking state."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.features.geometric import TransformPrior
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import grey, limit_depth, rectified
from rgbd_glue_ros.odometry.acceptance import is_conclusive, is_plausible, score
from rgbd_glue_ros.odometry.depth_color_check import DepthColorCheck
from rgbd_glue_ros.odometry.drift_correction import DriftCorrection
from rgbd_glue_ros.odometry.dynamic_objects import without_dynamic_objects
from rgbd_glue_ros.odometry.keyframe_edges import edge_from, unseen_covariance
from rgbd_glue_ros.odometry.keyframes import Anchor, Keyframe, Keyframes
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.parameters import Config, RefineConfig
from rgbd_glue_ros.refinement.gauss_newton import (
    COARSE_TO_FINE,
    START_BRIGHTNESS,
    Refinement,
    evaluate_pose,
    refine,
)
from rgbd_glue_ros.refinement.model import Model, blend, model_of
from rgbd_glue_ros.refinement.rolling_shutter import twist_from_distortion
from rgbd_glue_ros.refinement.time_offsets import TimeOffsets
from rgbd_glue_ros.registration.glue import FrameFeatures, Glue
from rgbd_glue_ros.stopwatch import timed
from rgbd_glue_ros.types import (
    NANOSECONDS,
    EdgeOrigin,
    Float64,
    OdometryEstimate,
    PoseGraphEdge,
    RegistrationResult,
    RegistrationStatus,
    RgbdFrame,
    TrackingState,
    View,
)

_Known = TypeVar("_Known")
# Refined from far apart, poses that end nearer than this, metres and radians added, are the same.
_SAME = 0.01
# The levels that poses are compared at, and those that the best is finished at one by one, each
# with the velocity that is known by then: the images of a fast camera depend on that.
_COARSE, (_FINER, _FINEST) = COARSE_TO_FINE[:-1], COARSE_TO_FINE[-2:]
# Between frames farther apart a velocity says too little of the moment of one to time it.
_STEADY_NS = NANOSECONDS // 10
# A hand-held camera or a robot indoors: how far a lost pose may be off after a second.
_LOST_SPREAD = np.diag([1.0, 1.0, 1.0, 0.5, 0.5, 0.5]) ** 2
# The first pose is exact by definition; filters need a covariance that is not singular.
_ORIGIN_COVARIANCE = np.eye(6) * 1e-8


@dataclass(frozen=True)
class _Found:
    """A refined pose, and the velocity that the frame's distortion shows, with its covariance.

    ``twist`` is None where nobody looked.
    """

    refinement: Refinement
    twist: tuple[Float64, Float64] | None = None


@dataclass(frozen=True)
class _Fix:
    """A pose found for a frame, and the evidence for it.

    ``reference`` is the keyframe that it was registered against, ``model`` what it was refined
    against.
    """

    found: _Found
    reference: Keyframe
    registration: RegistrationResult
    model: Model


@dataclass(frozen=True)
class _Scene:
    """What the pose of a frame is refined in: against what, from where, and how."""

    model: Model
    view: View
    predicted: Motion
    config: RefineConfig

    def moving(self, twist: Float64) -> _Scene:
        """The same, with another velocity of the camera."""
        return replace(self, view=replace(self.view, twist=twist))

    def refined(
        self,
        T: Float64,
        levels: Sequence[int],
        affine_brightness: Sequence[float] | Float64 = START_BRIGHTNESS,
    ) -> Refinement:
        """A pose refined from T at some levels, under a light as far as it is known."""
        return refine(T, self.model, self.view, self.config, levels, affine_brightness)


@dataclass(frozen=True)
class _Ahead:
    """A prediction that is refined beside the registration, each with the milliseconds it takes."""

    coarse: Future[tuple[Refinement, float]]
    finished: Future[tuple[_Found, float]]


@dataclass(frozen=True)
class _Search:
    """What the pose of a frame is looked for by.

    ``reference`` is the nearest keyframe, and ``scene`` has the model of the nearest few; ``prior``
    is where the frame is in ``reference`` by the prediction, and ``ahead`` its refinement; both are
    None where the prediction is none.
    """

    features: FrameFeatures
    reference: Keyframe
    scene: _Scene
    prior: TransformPrior | None
    ahead: _Ahead | None


@dataclass(frozen=True)
class _Posed:
    """A frame with a pose, which may become a keyframe.

    ``covariance`` is that of the pose, perturbation on the left, odom frame; ``reference`` the
    keyframe that it was found from.
    """

    stamp_ns: int
    T_track_camera: Float64
    covariance: Float64
    features: FrameFeatures
    reference: Keyframe


class Odometry:
    """Turns RGB-D frames into poses T_odom_camera.

    Deterministic: the same frames and configuration give the same bits. Not thread-safe: one
    thread calls.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._glue = Glue(config)
        self.reset()

    def reconfigure(self, config: Config) -> None:
        """Goes on by other parameters, none of which is fixed."""
        self._config = config
        self._glue.reconfigure(config)

    def reset(self) -> None:
        """Forgets everything; the next frame starts a new odom frame at the identity."""
        self.state = TrackingState.INITIALIZING
        self._keyframes = Keyframes(self._config.odometry)
        self._posed: _Posed | None = None
        self._motion: Motion | None = None
        self._time_offsets = _at_once(TimeOffsets.start(self._config.time_offsets, ""))
        self._drift = _at_once(DriftCorrection.at(np.eye(4)))
        self._depth_color_check = _at_once(DepthColorCheck.start())
        self._last_stamp_ns: int | None = None
        self._missed = 0
        self._T_guess_last: Float64 | None = None
        self._edges: list[PoseGraphEdge] = []

    def process(self, frame: RgbdFrame, T_guess_camera: Float64 | None = None) -> OdometryEstimate:
        """``track`` and ``update_map`` in one, for whom the pose alone is in no hurry.

        Returns:
            What ``track`` does, and what came of the frame in ``update_map`` and ``new_edges``.
        """
        estimate = self.track(frame, T_guess_camera)
        became_one, ms = timed(self.update_map)
        stages = {**estimate.stages_ms, "keyframe": ms}
        is_keyframe = became_one or estimate.is_keyframe
        edges = self.new_edges()
        return replace(estimate, is_keyframe=is_keyframe, edges=edges, stages_ms=stages)

    def track(self, frame: RgbdFrame, T_guess_camera: Float64 | None = None) -> OdometryEstimate:
        """Registers a frame and returns what is known after it.

        Args:
            frame: later than the one before.
            T_guess_camera: float64 [4, 4], the camera's pose by another odometry, in a fixed frame
                of its own; None if there is none. Its motion since the last pose is where the
                search starts.

        Returns:
            The estimate; whether the frame becomes a keyframe is for ``update_map`` to say, except
            of one that starts anew, which is one already.

        Raises:
            InputError: the frame is not later than the one before. Nothing else raises: an image
                that shows nothing gives an estimate without a pose.
        """
        self.update_map()
        if self._last_stamp_ns is not None and frame.stamp_ns <= self._last_stamp_ns:
            raise InputError(
                f"frame at {frame.stamp_ns} ns",
                f"not later than the frame before, at {self._last_stamp_ns} ns",
                "leave it out, or call reset() when time starts again",
            )
        self._last_stamp_ns = frame.stamp_ns
        estimate = self._tracked(frame, T_guess_camera)
        if estimate.T_odom_camera is not None:
            self._T_guess_last = T_guess_camera
        return estimate

    def update_map(self) -> bool:
        """Makes a keyframe of the frame tracked last, where it is time.

        That takes a while, and no pose waits for it but that of the next frame: call it when the
        pose is on its way. Where nobody does, the next ``track`` does.

        Returns:
            Whether the frame became one.
        """
        posed, self._posed = self._posed, None
        if posed is None:
            return False
        shown = self._as_keyframe(posed)
        if shown is None:
            return False
        drift, T = self._drift.result(), posed.T_track_camera
        keyframe = self._keyframes.add(posed.stamp_ns, T, posed.covariance, *shown, drift.target)
        relative = posed.covariance - posed.reference.covariance
        self._edges.append(edge_from(posed.reference, keyframe.number, T, relative))
        anchor = self._keyframes.anchor(drift.target @ T, self._config.odometry.drift_radius)
        if anchor is not None:
            # the pose of the next frame is the first to need it
            config = replace(self._config, refine=self._refining)
            self._drift = self._glue.background.submit(
                drift.after_revisit, keyframe, anchor, config
            )
        return True

    @property
    def newest_keyframe(self) -> Keyframe | None:
        """The keyframe made last; None before the first."""
        return next(iter(self._keyframes.latest(1)), None)

    @property
    def refine_config(self) -> RefineConfig:
        """How poses are refined, as the camera is known by now."""
        return self._refining

    def new_edges(self) -> tuple[PoseGraphEdge, ...]:
        """What was measured between keyframes since the last call.

        A keyframe's edge to the one that it was tracked from is there after ``update_map``; that
        to an anchor, after the next ``track``.
        """
        edges, self._edges = tuple(self._edges), []
        return edges

    def _tracked(self, frame: RgbdFrame, T_guess_camera: Float64 | None) -> OdometryEstimate:
        predicted = self._predicted(frame.stamp_ns, T_guess_camera)
        view, preparation_ms = timed(self._view, frame, predicted)
        stages = {"preparation": preparation_ms}
        if self._motion is None or predicted is None:
            return self._begin(frame.stamp_ns, self._glue.extract(view), stages)
        search = self._search(view, predicted)
        stages |= search.features.stages_ms
        tracked = self._track(search, self._motion)
        drift = self._drift.result()
        if drift.edge is not None:
            self._edges.append(drift.edge)
            self._drift = _at_once(replace(drift, edge=None))
        if isinstance(tracked, _Fix):
            return self._accept(self._motion, predicted, search.features, tracked, stages)
        relocalised = self._relocalise(search.features, self._motion, predicted)
        if relocalised is not None:
            if isinstance(relocalised.reference, Anchor):
                # a pose found from there has drifted as much as that has, and no more
                self._drift = _at_once(DriftCorrection.at(relocalised.reference.T_odom_track))
            return self._accept(self._motion, predicted, search.features, relocalised, stages)
        missed = OdometryEstimate(
            frame.stamp_ns, TrackingState.LOST, registration=tracked, stages_ms=stages
        )
        return self._miss(self._motion, search.features, missed)

    def _predicted(self, stamp_ns: int, T_guess_camera: Float64 | None) -> Motion | None:
        """The motion at a stamp as far as it is known before the images are; None at the start."""
        if self._motion is None:
            return None
        predicted = self._motion.predicted(stamp_ns, self._config.motion)
        if self._T_guess_last is None or T_guess_camera is None:
            return predicted
        step = se3.inverse(self._T_guess_last) @ T_guess_camera
        return replace(predicted, T_track_camera=self._motion.T_track_camera @ step)

    def _view(self, frame: RgbdFrame, predicted: Motion | None) -> View:
        """The frame without distortion, its depth in range, and how it was taken."""
        frame = rectified(frame)
        depth = limit_depth(frame.depth, self._config.camera)
        if predicted is None:
            self._time_offsets = _at_once(
                TimeOffsets.start(self._config.time_offsets, frame.frame_id)
            )
        time_offsets = self._time_offsets.result()
        twist = np.zeros(6) if predicted is None else predicted.twist
        delay = frame.depth_delay_ns / NANOSECONDS - time_offsets.depth_latency
        return View(
            grey(frame.color), depth, frame.intrinsics, twist, time_offsets.readout_time, delay
        )

    def _search(self, view: View, predicted: Motion) -> _Search:
        """What registration and refinement start from; the refinement from the prediction runs."""
        odometry, T_predicted = self._config.odometry, predicted.T_track_camera
        references = self._references(T_predicted)
        model = blend([keyframe.model for keyframe in references])
        scene = _Scene(model, view, predicted, self._refining)
        prior, ahead = None, None
        if odometry.prior_radius > 0:
            T_reference_predicted = se3.inverse(references[0].T_track_camera) @ T_predicted
            prior = TransformPrior(T_reference_predicted, odometry.prior_radius)
            ahead = self._refined_beside(scene)
        # meanwhile, on this thread
        features = self._glue.extract(view)
        return _Search(features, references[0], scene, prior, ahead)

    def _refined_beside(self, scene: _Scene) -> _Ahead:
        submit = self._glue.background.submit
        coarse = submit(timed, scene.refined, scene.predicted.T_track_camera, _COARSE)
        finished = submit(lambda: timed(self._finished, coarse.result()[0], scene))
        return _Ahead(coarse, finished)

    def _track(self, search: _Search, last: Motion) -> _Fix | RegistrationResult:
        """Registers against the nearest keyframe and refines against the nearest few.

        Returns:
            A pose, or the registration that says why there is none.
        """
        result = self._glue.register(search.features, search.reference.features, search.prior)
        found, result.stages_ms["refinement"] = self._found(search, result)
        if found is None:
            return result
        best, scene, config = found.refinement, search.scene, self._config.odometry
        if not is_plausible(best, best.planes_visible, config) or not (
            last.reaches(best.T_model_source, scene.predicted) or is_conclusive(best, config)
        ):
            return result.refused(RegistrationStatus.INCONSISTENT)
        return _Fix(found, search.reference, result, scene.model)

    def _found(self, search: _Search, result: RegistrationResult) -> tuple[_Found | None, float]:
        """The pose refined from the prediction, or from the registration where that fits better.

        Returns:
            It, and the milliseconds that its refinement took.
        """
        scene = search.scene
        best, best_ms = (None, 0.0) if search.ahead is None else search.ahead.coarse.result()
        if result.T_target_source is not None:
            T = search.reference.T_track_camera @ result.T_target_source
            if best is None or self._far(best, T):
                other, coarse_ms = timed(scene.refined, T, _COARSE)
                if best is None or _is_better(other, best):
                    found, ms = timed(self._finished, other, scene)
                    return found, coarse_ms + ms
        if search.ahead is None:
            return None, 0.0
        found, ms = search.ahead.finished.result()
        return found, best_ms + ms

    def _references(self, T_track_camera: Float64) -> list[Keyframe]:
        """The keyframes that a frame there is compared with, the nearest first."""
        return self._keyframes.nearest(T_track_camera)[: self._config.odometry.references]

    @property
    def _refining(self) -> RefineConfig:
        """How poses are refined: with less trust in colour where depth is not registered to it."""
        config = self._config.refine
        if self._depth_color_check.result().offset_px is None:
            return config
        return replace(config, pixel_weight=min(config.pixel_weight, config.unregistered_weight))

    def _finished(self, coarse: Refinement, scene: _Scene) -> _Found:
        """Refines further under the velocity that the frame had; what was, if that fails."""
        T, predicted = coarse.T_model_source, scene.predicted
        moving = scene.moving(self._corrected(predicted, _Found(coarse)).twist)
        finer = moving.refined(T, [_FINER])
        seen = twist_from_distortion(finer, moving.model, moving.view, moving.config, _FINER)
        moving = scene.moving(self._corrected(predicted, _Found(finer, seen)).twist)
        finest = moving.refined(finer.T_model_source, [_FINEST], finer.affine_brightness)
        if is_plausible(finest, finest.planes_visible, self._config.odometry):
            return _Found(finest, seen)
        return _Found(evaluate_pose(T, scene.model, scene.view, scene.config))

    def _relocalise(self, features: FrameFeatures, last: Motion, predicted: Motion) -> _Fix | None:
        """Looks for the frame near a few keyframes, without a prior and more sceptically.

        The latest come first; while the camera stays lost, frame by frame all others. Planes that
        are hidden count as well: somebody before the camera is no proof of a place.
        """
        odometry = self._config.odometry
        for keyframe in self._keyframes.in_turn(odometry.relocalisation_attempts, self._missed):
            result = self._glue.register(features, keyframe.features)
            if (
                result.T_target_source is None
                or len(result.visual_inliers) < odometry.relocalisation_inliers
            ):
                continue
            T = keyframe.T_track_camera @ result.T_target_source
            refined = refine(T, keyframe.model, features.view, self._refining)
            if (
                is_plausible(refined, refined.planes_seen, odometry)
                and refined.brightness_correlation >= odometry.brightness_correlation
                and (
                    last.reaches(refined.T_model_source, predicted)
                    or is_conclusive(refined, odometry)
                )
            ):
                return _Fix(_Found(refined), keyframe, result, keyframe.model)
        return None

    def _corrected(self, predicted: Motion, found: _Found) -> Motion:
        """The predicted motion, corrected by a pose and by a velocity where one was seen."""
        T = found.refinement.T_model_source
        information = (
            found.refinement.information / self._config.refine.residuals_per_independent_one
        )
        covariance = np.asarray(
            np.linalg.inv(information + np.linalg.inv(_LOST_SPREAD)), np.float64
        )
        to_body = se3.adjoint(se3.inverse(T))
        motion = predicted.corrected(T, to_body @ covariance @ to_body.T)
        return motion if found.twist is None else motion.corrected_by_twist(*found.twist)

    def _far(self, found: Refinement, T_other: Float64) -> bool:
        odometry = self._config.odometry
        T = se3.inverse(found.T_model_source) @ T_other
        return bool(
            np.linalg.norm(T[:3, 3]) > odometry.surprise_translation
            or se3.rotation_angle(T) > odometry.surprise_rotation
        )

    def _begin(
        self, stamp_ns: int, features: FrameFeatures, stages: dict[str, float]
    ) -> OdometryEstimate:
        """The first frame that shows enough becomes the origin of the odom frame."""
        model = model_of(features.view, self._config.refine.grid_step)
        if len(model.planes.points) < self._config.odometry.min_planes:
            return OdometryEstimate(stamp_ns, self.state, stages_ms=stages)
        target = self._drift.result().target
        first = self._keyframes.add(
            stamp_ns, np.eye(4), _ORIGIN_COVARIANCE, features, model, target
        )
        return self._start_at(first, stages | features.stages_ms)

    def _start_at(self, keyframe: Keyframe, stages: dict[str, float]) -> OdometryEstimate:
        """Starts anew at the pose of a keyframe, and says so."""
        self._motion = Motion.start(keyframe.stamp_ns, keyframe.T_track_camera)
        self.state = TrackingState.TRACKING
        T = self._drift.result().T_odom_track @ keyframe.T_track_camera
        return OdometryEstimate(
            keyframe.stamp_ns,
            self.state,
            T,
            se3.pose_covariance(T, keyframe.covariance),
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
        adjoint = se3.adjoint(motion.T_track_camera)
        spread = adjoint @ (_LOST_SPREAD * seconds**2) @ adjoint.T
        covariance = last.covariance + spread
        self._keyframes.forget()
        target = self._drift.result().target
        anew = self._keyframes.add(
            stamp_ns, motion.T_track_camera, covariance, features, model, target
        )
        self._missed = 0
        T = anew.T_track_camera
        self._edges.append(edge_from(last, anew.number, T, spread, EdgeOrigin.ASSUMED))
        return self._start_at(anew, missed.stages_ms)

    def _accept(
        self,
        last: Motion,
        predicted: Motion,
        features: FrameFeatures,
        fix: _Fix,
        stages: dict[str, float],
    ) -> OdometryEstimate:
        """Corrects the motion by the pose, and makes a keyframe where it is time."""
        motion = self._corrected(predicted, fix.found)
        steady = motion.stamp_ns - last.stamp_ns <= _STEADY_NS
        self._motion = motion
        self._missed = 0
        self.state = TrackingState.TRACKING
        T = motion.T_track_camera
        rate = self._config.odometry.drift_rate
        drift = self._drift.result().advanced(last.T_track_camera, T, rate)
        self._drift = _at_once(drift)
        covariance = fix.reference.covariance + self._relative_covariance(motion, fix.reference)
        # now that the frame has a pose, its velocity is known better than it was before
        features = replace(features, view=replace(features.view, twist=motion.twist))
        time_offsets = self._time_offsets.result()
        if steady and not time_offsets.settled:
            # the next frame is the first to need it
            self._time_offsets = self._glue.background.submit(
                time_offsets.corrected,
                fix.found.refinement,
                fix.model,
                features.view,
                self._refining,
                self._config.time_offsets,
            )
        check = self._depth_color_check.result()
        if check.needs_view_from(T):
            self._depth_color_check = self._glue.background.submit(
                check.after_view, features.view, T
            )
        self._posed = _Posed(motion.stamp_ns, T, covariance, features, fix.reference)
        T_odom_camera = drift.T_odom_track @ T
        return OdometryEstimate(
            motion.stamp_ns,
            self.state,
            T_odom_camera,
            se3.pose_covariance(T_odom_camera, covariance),
            motion.twist,
            motion.covariance[6:, 6:],
            keyframe_id=fix.reference.number,
            registration=fix.registration,
            stages_ms={**stages, **fix.registration.stages_ms},
        )

    def _relative_covariance(self, motion: Motion, reference: Keyframe) -> Float64:
        """Covariance [6, 6] of a pose relative to its keyframe, perturbation on the left.

        That of the motion, and what no residual shows: errors of time and of scale.
        """
        odometry = self._config.odometry
        T = motion.T_track_camera
        distance = float(np.linalg.norm(T[:3, 3] - reference.T_track_camera[:3, 3]))
        unseen = unseen_covariance(motion.twist, distance, odometry)
        adjoint = se3.adjoint(T)
        covariance: Float64 = adjoint @ (motion.covariance[:6, :6] + unseen) @ adjoint.T
        return covariance

    def _as_keyframe(self, posed: _Posed) -> tuple[FrameFeatures, Model] | None:
        """What a frame that should become a keyframe shows of the room; None if it should not."""
        odometry, reference = self._config.odometry, posed.reference
        T = se3.inverse(reference.T_track_camera) @ posed.T_track_camera
        way = max(
            float(np.linalg.norm(T[:3, 3])) / odometry.keyframe_translation,
            se3.rotation_angle(T) / odometry.keyframe_rotation,
        )
        if way < 1:
            return None
        features, model = self._of_the_room(posed)
        if len(model.planes.points) < odometry.min_planes:
            return None
        # a blurred image is a poor keyframe: a sharper one is probably on its way
        blurred = 2 * len(model.pixels[0].points) < len(reference.model.pixels[0].points)
        return None if blurred and way < 2 else (features, model)

    def _of_the_room(self, posed: _Posed) -> tuple[FrameFeatures, Model]:
        """A frame's features and model without what moves."""
        features, grid_step = posed.features, self._config.refine.grid_step
        near = self._references(posed.T_track_camera)
        others = [(keyframe.features.view, keyframe.T_track_camera) for keyframe in near]
        view = without_dynamic_objects(features.view, posed.T_track_camera, others)
        if view is None:
            return features, model_of(features.view, grid_step)
        anew = self._glue.background.submit(self._glue.seen_anew, features, view)
        model = model_of(view, grid_step)
        return anew.result(), model


def _at_once(known: _Known) -> Future[_Known]:
    """What is known already, as what is being found out."""
    future: Future[_Known] = Future()
    future.set_result(known)
    return future


def _is_better(found: Refinement, than: Refinement) -> bool:
    """Whether a refinement ended elsewhere than another one, and fits better."""
    apart = se3.difference(found.T_model_source, than.T_model_source)
    return apart > _SAME and score(found) > score(than)
