"""Keyframe odometry: gives every frame a pose, or reports that it has none."""

from __future__ import annotations

from dataclasses import replace

from rgbd_glue_ros.closing import Closing, uninterrupted
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.background import BackgroundThread
from rgbd_glue_ros.odometry.depth_diagnosis import StartWarning
from rgbd_glue_ros.odometry.keyframe import NewestKeyframe
from rgbd_glue_ros.odometry.session import Session
from rgbd_glue_ros.parameters import Config, check_changes, load_preset
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.stopwatch import timed
from rgbd_glue_ros.types import (
    Float64,
    ImuCalibration,
    ImuSamples,
    OdometryEstimate,
    PoseGraphEdge,
    RgbdFrame,
    TrackingState,
    stages,
)
from rgbd_glue_ros.types.checks import check_class, check_guess


class Odometry(Closing):
    """Turns RGB-D frames into poses T_odom_camera.

    Deterministic: the same frames and configuration give the same bits. Not thread-safe: call it
    from one thread, of the process that created it; its own thread ends with ``close`` or a
    ``with``. By default it has the preset ``live`` and creates its ``Glue``. Ctrl-C interrupts it
    when a frame is done.
    """

    def __init__(self, config: Config | None = None, glue: Glue | None = None) -> None:
        config = load_preset("live") if config is None else config
        check_class("Odometry.config", config, Config, "load_preset('live') or another")
        self._config = config
        self._glue = glue or Glue(self._config)
        self._background = BackgroundThread()
        self._start_warning = StartWarning()
        self.reset()

    def close(self) -> None:
        """Ends the background thread; no frame or keyframe can be added after that."""
        self._background.close()

    def reconfigure(self, config: Config) -> None:
        """Uses other parameters from the next frame on.

        Raises:
            InputError: one that is fixed while frames are tracked has another value.
        """
        check_changes(self._config, config)
        self._config = config
        self._glue.reconfigure(config)
        self._session.reconfigure(config)

    def reset(self) -> None:
        """Forgets everything; the next frame starts a new odom frame at the identity."""
        self._session = Session(self._glue, self._background, self._config)

    def add_imu(self, samples: ImuSamples) -> None:
        """Adds samples of an IMU, in the axes of the camera's optical frame; optional.

        They may come in any order; of two with one stamp, the first is kept. Samples are used if
        they are added before ``track`` or ``process`` is called with the frame that they lead up
        to. For frames that they do not cover, motion is predicted without them.

        Raises:
            InputError: ``samples`` are of another class.
        """
        check_class("add_imu.samples", samples, ImuSamples, "ImuSamples(stamps_ns, ...)")
        self._session.add_imu(samples)

    @property
    def imu_calibration(self) -> ImuCalibration:
        """What was learnt about the IMU so far, and what it is used for."""
        return self._session.inertial.calibration

    def up(self, stamp_ns: int) -> Float64 | None:
        """The unit vector [3] away from the earth, in the optical frame; None if unknown."""
        return self._session.inertial.up(stamp_ns)

    @property
    def state(self) -> TrackingState:
        """The state after the last frame."""
        return self._session.state

    def process(self, frame: RgbdFrame, T_guess_camera: Float64 | None = None) -> OdometryEstimate:
        """``track``, completed by ``update_map`` and ``new_edges``.

        Why there is no first pose is logged as a warning, once for each cause.
        """
        estimate = completed(self.track(frame, T_guess_camera), self)
        self._start_warning.take(estimate, self._config.camera)
        return estimate

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
        check_class(
            "track.frame", frame, RgbdFrame, "RgbdFrame(stamp_ns, color, depth, intrinsics)"
        )
        if T_guess_camera is not None:
            check_guess(T_guess_camera)
            # whatever is no rotation in it would be multiplied into the pose, frame by frame
            T_guess_camera = se3.with_nearest_rotation(T_guess_camera)
        return self._session.track(frame, T_guess_camera)

    @uninterrupted()
    def update_map(self) -> bool:
        """Makes a keyframe of the frame tracked last, if it is due.

        This takes a while, and only the next frame's pose waits for it: call it after publishing
        the pose. Otherwise the next ``track`` calls it.

        Returns:
            Whether the frame became a keyframe.

        Raises:
            InputError: the odometry was closed.
        """
        self._background.check_open()
        return self._session.update_map()

    @property
    def newest_keyframe(self) -> NewestKeyframe | None:
        """The keyframe made last; None before the first."""
        return self._session.keyframes.newest()

    def learnt_config(self) -> Config:
        """The parameters adapted to this camera: refinement and errors of poses."""
        return self._session.calibration.learnt_config()

    def new_edges(self) -> tuple[PoseGraphEdge, ...]:
        """The edges measured between keyframes since the last call.

        A keyframe's edge to the one that it was tracked from is available after ``update_map``;
        that to an anchor, after the next ``track``.
        """
        return self._session.keyframes.take_edges()


def completed(estimate: OdometryEstimate, odometry: Odometry) -> OdometryEstimate:
    """The estimate of the frame tracked last, completed by ``update_map`` and ``new_edges``."""
    became_keyframe, ms = timed(odometry.update_map)
    return replace(
        estimate,
        is_keyframe=became_keyframe or estimate.is_keyframe,
        edges=odometry.new_edges(),
        stages_ms={**estimate.stages_ms, stages.KEYFRAME: ms},
    )
