"""The odometry node: subscribes to an RGB-D camera, publishes its pose.

Subscription callbacks only pair messages by stamp. A worker thread converts the newest complete
frame, runs the odometry on it and publishes. So a slow frame does not block the subscriptions; of
the frames that arrive meanwhile the newest is kept, and the others are dropped and counted.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

from rclpy.exceptions import InvalidHandle
from std_srvs.srv import Empty

from rgbd_glue_ros import parameters as cfg
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.features.weights import learned_features
from rgbd_glue_ros.files.user_paths import file_to_write
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.camera_frame import CameraFrame
from rgbd_glue_ros.live.end_signals import EndSignals
from rgbd_glue_ros.live.extrinsics import Extrinsics
from rgbd_glue_ros.live.frame_counts import Drop
from rgbd_glue_ros.live.heap import exempt_loaded_objects
from rgbd_glue_ros.live.imu_faults import explain_distrust
from rgbd_glue_ros.live.keyframe_graph import KeyframeGraph, moved_edge
from rgbd_glue_ros.live.worker import NewestWorker, QueueWorker, Worker
from rgbd_glue_ros.messages.poses import pose_parameter
from rgbd_glue_ros.messages.synchronizer import Match
from rgbd_glue_ros.node.base_node import CLOSE_S, BaseNode
from rgbd_glue_ros.node.diagnostics import NodeDiagnostics
from rgbd_glue_ros.node.extrinsics import NodeExtrinsics
from rgbd_glue_ros.node.guess import guess_input
from rgbd_glue_ros.node.imu import ImuInput
from rgbd_glue_ros.node.outputs import NodeOutputs, PublishedPose
from rgbd_glue_ros.node.parameters import NO_CAMERA, declare_parameters, follow_changes
from rgbd_glue_ros.node.rgbd_input import RgbdInput
from rgbd_glue_ros.node.runtime import run_node
from rgbd_glue_ros.node.saving import create_save_service
from rgbd_glue_ros.node.state_log import log_state, sentence
from rgbd_glue_ros.node.tf import listen
from rgbd_glue_ros.node.viewer import NodeViewer
from rgbd_glue_ros.odometry.depth_diagnosis import doubt_at_start, explain_no_pose
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.odometry.warm_up import warm_up
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.types import NANOSECONDS, OdometryEstimate, RgbdFrame, TrackingState

logger = logging.getLogger(f"{cfg.PACKAGE}.node")  # __name__ is __main__ when run

NODE_NAME = "rgbd_odometry"
WARMING_UP = "warming up; the very first time this compiles, for a minute or two"
# Frames may be early by this fraction of the period of max_update_rate, since stamps jitter.
EARLY_FRACTION = 0.1


@dataclass(frozen=True)
class _Arrival:
    """The messages of a frame, and when the last of them arrived, by the monotonic clock."""

    match: Match[Any]
    arrived_ns: int


@dataclass(frozen=True, eq=False)
class _Tracked:
    """A frame, and what has been published of it.

    Attributes:
        frame: the frame.
        state_before: the odometry's state before it, and after a reset.
        estimate: its estimate.
        extrinsics: what the pose was published with.
        pose: as published; None if there is none.
    """

    frame: RgbdFrame
    state_before: TrackingState
    estimate: OdometryEstimate
    extrinsics: Extrinsics
    pose: PublishedPose | None


class OdometryNode(BaseNode):
    """RGB-D odometry as a node."""

    def __init__(
        self, give_up: Callable[[], None], camera: Mapping[str, cfg.Value] = NO_CAMERA
    ) -> None:
        """Declares the parameters, and warms up; subscribes as soon as that is done.

        Args:
            give_up: called from another thread if the warm-up fails, as every frame then would.
            camera: as for ``declare_parameters``.

        Raises:
            InputError: a parameter has an invalid value.
        """
        super().__init__(NODE_NAME)
        self._give_up = give_up
        self._node_config, self._config = declare_parameters(self, camera)
        transforms = self._transforms = listen(self, self._node_config)
        self._extrinsics = NodeExtrinsics(self, self._node_config, transforms)
        self._guesses = guess_input(self, self._node_config, transforms)
        glue = Glue(self._config)
        self._odometry = Odometry(self._config, glue)
        self._camera_frame = CameraFrame()
        self._last_stamp_ns: int | None = None
        self._last_taken_ns: int | None = None
        # to be run on the worker's thread, before the next frame
        self._requests: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._worker = self._create_worker()
        learned = learned_features(self._config.features)
        self._input = RgbdInput(self, self._node_config, transforms, self._receive, learned)
        self._imu = ImuInput(self, self._node_config, transforms, lambda: self._input.is_by_receipt)
        self._graph = KeyframeGraph()
        self._outputs = NodeOutputs(self, self._node_config, has_tf=transforms is not None)
        self._viewer = NodeViewer(self._node_config.rerun)
        self._diagnostics = NodeDiagnostics(
            self, self.monitor, self._input.synchronizer, self._input.watch
        )
        for name, serve in (
            (topics.RESET_SERVICE, self._serve_reset),
            (topics.PAUSE_SERVICE, self._serve_pause),
            (topics.RESUME_SERVICE, self._serve_resume),
        ):
            self.create_service(Empty, name, serve)
        create_save_service(self, topics.SAVE_GRAPH_SERVICE, "graph", self._save_graph)
        follow_changes(self, self._node_config, self._config, self._take_parameters)
        self.monitor.preparing = WARMING_UP
        self._warmed_up = self.create_guard_condition(self._subscribe)
        # a daemon: the first compilation takes long, and must not delay the end of the process
        threading.Thread(target=self._warm_up, args=[glue], name="warm-up", daemon=True).start()

    def _finish(self) -> bool:
        """Finishes the current frame, and logs a summary of all frames."""
        has_ended = self._worker.close(CLOSE_S)
        self.get_logger().info(str(self.monitor.summary(time.monotonic_ns())))
        if has_ended:
            self._input.close()
            self._odometry.close()
            self._viewer.close()
        return has_ended

    def _create_worker(self) -> Worker[_Arrival]:
        if self._node_config.always_process_most_recent_frame:
            return NewestWorker(self._process, lambda _: self.monitor.dropped(Drop.SUPERSEDED))
        return QueueWorker(self._process, self._node_config.sync_queue_size)

    def _take_parameters(self, node_config: cfg.NodeConfig, config: cfg.Config) -> None:
        """Applies changed parameters from the next frame on."""
        self._node_config = node_config
        self._outputs.reconfigure(node_config)
        # both on the worker's thread, so that a missing pose is explained with the limits that
        # were in force for its frame
        self._requests.put(lambda: self._reconfigure(config))

    def _reconfigure(self, config: cfg.Config) -> None:
        self._config = config
        self._odometry.reconfigure(config)

    # Services

    def _serve_reset(self, _request: object, response: Empty.Response) -> Empty.Response:
        self._requests.put(self._reset)
        self.get_logger().info("Reset requested: restarting with the next frame")
        return response

    def _serve_pause(self, _request: object, response: Empty.Response) -> Empty.Response:
        self.monitor.is_paused = True
        self.get_logger().info("Paused: no frame is processed until ~/resume_odom is called")
        return response

    def _serve_resume(self, _request: object, response: Empty.Response) -> Empty.Response:
        self.monitor.is_paused = False
        self.get_logger().info("Resumed")
        return response

    def _save_graph(self) -> str:
        return self._graph.save(file_to_write(self._node_config.graph_file, "graph_file"))

    # Input

    def _warm_up(self, glue: Glue) -> None:
        self.get_logger().info(sentence(WARMING_UP))
        try:
            # no frame arrives before this has ended, so sharing the features is safe
            warm_up(self._config, glue)
        except Exception:
            logger.exception("Warming up failed, as every frame would: the node ends")
            self._give_up()
            return
        exempt_loaded_objects()
        with contextlib.suppress(InvalidHandle):  # the node has ended meanwhile
            self._warmed_up.trigger()

    def _subscribe(self) -> None:
        self._input.subscribe()
        self.monitor.preparing = ""
        self.get_logger().info(self._description())

    def _receive(self, match: Match[Any], arrived_ns: int) -> None:
        if self.monitor.is_paused:
            self.monitor.dropped(Drop.PAUSED)
        elif self._is_too_soon(match.stamp_ns):
            self.monitor.dropped(Drop.TOO_SOON)
        else:
            self._last_taken_ns = match.stamp_ns
            self._worker.submit(_Arrival(match, arrived_ns))

    def _is_too_soon(self, stamp_ns: int) -> bool:
        """Whether a frame comes sooner than ``max_update_rate`` allows, and must be skipped."""
        if self._last_taken_ns is None or self._node_config.max_update_rate <= 0:
            return False
        period_ns = NANOSECONDS / self._node_config.max_update_rate
        return 0 <= stamp_ns - self._last_taken_ns < (1 - EARLY_FRACTION) * period_ns

    # Work, on the worker's thread

    def _process(self, arrival: _Arrival) -> None:
        try:
            tracked = self._track(arrival)
        except InputError as fault:
            self.monitor.dropped(Drop.UNUSABLE, f"{fault.where}: {fault.cause}")
            self.report(fault)
        except Exception as error:
            self.monitor.dropped(Drop.FAILED, repr(error))
            self.report_failure(f"The frame at {arrival.match.stamp_ns} ns failed", error)
        else:
            if tracked is None:
                self.monitor.dropped(Drop.UNPLACED)
            else:
                self._finish_frame(tracked, arrival)

    def _track(self, arrival: _Arrival) -> _Tracked | None:
        """Tracks a frame and publishes its pose; None if the camera's pose is not known yet."""
        while not self._requests.empty():
            self._requests.get()()
        frame = self._camera_frame.named(self._input.frame(arrival.match))
        self._reset_if_other_camera(frame)
        self._reset_if_earlier(frame)
        state_before = self._odometry.state
        is_start = state_before is TrackingState.INITIALIZING
        if is_start:
            self.warn_once(self._input.depth_topic, doubt_at_start(frame.depth))
        extrinsics = self._extrinsics.of(frame.frame_id)
        if extrinsics is None:
            return None
        guess = None
        if self._guesses is not None:
            guess = self._guesses.at(frame.stamp_ns, extrinsics.T_camera_child)
        self._odometry.add_imu(self._imu.take(frame.frame_id, frame.stamp_ns))
        estimate = self._odometry.track(frame, None if guess is None else guess.T_guess_camera)
        if is_start and estimate.T_odom_camera is not None:
            up = self._odometry.up(frame.stamp_ns)
            extrinsics = self._extrinsics.level(up) or extrinsics
            self._outputs.publish_start(estimate, extrinsics)
        T_guess_child = None if guess is None else guess.T_guess_child
        pose = self._outputs.publish(estimate, extrinsics, frame, T_guess_child)
        return _Tracked(frame, state_before, estimate, extrinsics, pose)

    def _finish_frame(self, tracked: _Tracked, arrival: _Arrival) -> None:
        """Does all that can wait until the pose is published."""
        frame, estimate, extrinsics = tracked.frame, tracked.estimate, tracked.extrinsics
        why = explain_no_pose(estimate, self._config.camera, self._input.depth_topic)
        self.monitor.processed(estimate, arrival.arrived_ns, time.monotonic_ns(), why)
        try:
            imu = self._odometry.imu_calibration
            self.monitor.learnt(imu)
            self.warn_once("imu", explain_distrust(imu))
            log_state(self, tracked.state_before, estimate, why)
            is_keyframe = self._update_map(estimate, tracked.pose, extrinsics)
            self._outputs.show_matches(frame, estimate)
            self._viewer.show(frame, estimate, extrinsics, is_keyframe=is_keyframe)
        except Exception as error:
            self.report_failure("Something failed after the pose was published", error)

    def _update_map(
        self, estimate: OdometryEstimate, pose: PublishedPose | None, extrinsics: Extrinsics
    ) -> bool:
        """Updates keyframes and edges, which only later frames need, after the pose is published.

        Args:
            estimate: the estimate of the frame.
            pose: the published pose; None if there was none.
            extrinsics: the extrinsics that it was published with.

        Returns:
            Whether the frame became a keyframe.
        """
        try:
            is_keyframe = self._odometry.update_map() or estimate.is_keyframe
        except Exception as error:
            self.report_failure("A keyframe could not be made", error)
            return False
        keyframe = self._odometry.newest_keyframe
        if is_keyframe and pose is not None and keyframe is not None:
            self._outputs.publish_keyframe(pose)
            self._graph.add(keyframe.number, keyframe.stamp_ns, pose.T_odom_child)
        for edge in self._odometry.new_edges():
            between_children = moved_edge(edge, extrinsics.T_camera_child)
            self._graph.add_edge(between_children)
            stamp_ns = self._graph.stamp_ns(edge.child)
            if stamp_ns is not None:
                self._outputs.publish_edge(between_children, stamp_ns)
        return is_keyframe

    def _reset_if_other_camera(self, frame: RgbdFrame) -> None:
        """Resets, and looks up the extrinsics again, if the images are of another camera."""
        before = self._camera_frame.changes_to(frame.frame_id)
        if before is None:
            return
        self.get_logger().warning(
            f"The images are now from the camera {frame.frame_id!r}, before from {before!r}: "
            f"restarting, and publishing {self._node_config.frame_id or frame.frame_id}"
        )
        self._extrinsics.forget()
        self._reset()

    def _reset_if_earlier(self, frame: RgbdFrame) -> None:
        """Resets if time went back, as with a looping bag or a clock that was set."""
        if self._last_stamp_ns is not None and frame.stamp_ns < self._last_stamp_ns:
            back_s = (self._last_stamp_ns - frame.stamp_ns) / NANOSECONDS
            self.get_logger().warning(
                f"Time went back by {back_s:.3f} s (a looping bag?): restarting"
            )
            if self._transforms is not None:
                self._transforms.time_went_back()
            self._reset()
        self._last_stamp_ns = frame.stamp_ns

    def _reset(self) -> None:
        self._odometry.reset()
        self._extrinsics.start_at(pose_parameter("initial_pose", self._node_config.initial_pose))
        self._outputs.forget_path()
        self._viewer.start_anew()
        self._graph.clear()
        self.monitor.start_anew()
        self._last_stamp_ns = None

    def _description(self) -> str:
        """What the node subscribes to and publishes, with the frames for the user to check."""
        subscribed = ", ".join(self._input.topics)
        optional = f"{self._input.depth_info_topic} and {self._imu.topic}"
        child = self._node_config.frame_id or "the camera's optical frame"
        frames = f"{self._node_config.odom_frame_id} -> {child}"
        return (
            f"Subscribed to {subscribed}, and if they exist {optional}; publishing {frames}. "
            f"{self._extrinsics.description}"
        )


def main(
    args: list[str] | None = None,
    end_signals: EndSignals | None = None,
    camera: Mapping[str, cfg.Value] = NO_CAMERA,
) -> int:
    """Runs the node until SIGINT, SIGTERM or SIGHUP.

    Args:
        args: ROS arguments; None uses those of the process.
        end_signals: the signal handlers, if they were installed before this module was loaded,
            which takes a while.
        camera: as for ``declare_parameters``.

    Returns:
        The exit code of ``run_node``.
    """
    return run_node(NODE_NAME, lambda give_up: OdometryNode(give_up, camera), args, end_signals)
