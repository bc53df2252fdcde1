"""The ROS node: subscribes to an RGB-D camera, publishes its pose.

Subscription callbacks only pair messages by stamp; a worker thread converts the newest complete
frame, runs the odometry on it and publishes. So a slow frame delays nothing but itself, and what
comes meanwhile is dropped and counted, but for the newest.
"""

from __future__ import annotations

import contextlib
import logging
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from types import TracebackType
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry as OdometryMessage
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from rgbd_glue_ros import config as cfg
from rgbd_glue_ros import frames, message_fields, messages, topics
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.monitor import Drop, Input, Monitor, explain_silence
from rgbd_glue_ros.odometry import Odometry
from rgbd_glue_ros.sync import Channel, Match, Synchronizer
from rgbd_glue_ros.types import NANOSECONDS, Float64, OdometryEstimate, RgbdFrame, TrackingState
from rgbd_glue_ros.warm_up import warm_up
from rgbd_glue_ros.worker import NewestWorker

logger = logging.getLogger(f"{cfg.PACKAGE}.node")  # __name__ is __main__ when run

NODE_NAME = "rgbd_odometry"
DIAGNOSTIC_LEVELS = {
    TrackingState.INITIALIZING: DiagnosticStatus.WARN,
    TrackingState.TRACKING: DiagnosticStatus.OK,
    TrackingState.LOST: DiagnosticStatus.ERROR,
}

SILENCE_S = 5.0
DIAGNOSTICS_S = 1.0
# Long enough for the slowest frame; a launch system kills what takes longer to end.
CLOSE_S = 4.0


@dataclass(frozen=True)
class _Arrival:
    """A complete frame and when its last message came, by the monotonic clock."""

    match: Match[Any]
    arrived_ns: int


class _Subscribed:
    """A subscription that takes the reliability its publishers offer, unless one is set.

    A reliable subscription gets nothing from a best-effort publisher, and a best-effort one may
    lose images of a reliable publisher; which one comes up is not known before it does.
    """

    def __init__(
        self,
        node: Node,
        channel: Channel,
        message_type: type,
        topic: str,
        receive: Callable[[Channel, Any], None],
        node_config: cfg.NodeConfig,
    ) -> None:
        self.channel = channel
        self.topic = topic
        self._node = node
        self._type = message_type
        self._receive = receive
        self._depth = node_config.topic_queue_size
        self._matches_publisher = node_config.qos == 0
        self._reliability = (
            ReliabilityPolicy.RELIABLE if node_config.qos == 1 else ReliabilityPolicy.BEST_EFFORT
        )
        self._subscription = self._subscribe()

    def _subscribe(self) -> Subscription:
        return self._node.create_subscription(
            self._type,
            self.topic,
            lambda message: self._receive(self.channel, message),
            QoSProfile(depth=self._depth, reliability=self._reliability),
            event_callbacks=SubscriptionEventCallbacks(
                matched=self._publishers_changed, incompatible_qos=self._publishers_changed
            ),
        )

    def _publishers_changed(self, _event: object) -> None:
        offered = {
            info.qos_profile.reliability
            for info in self._node.get_publishers_info_by_topic(self.topic)
        }
        if not offered:
            return
        best = (
            ReliabilityPolicy.RELIABLE
            if offered == {ReliabilityPolicy.RELIABLE}
            else ReliabilityPolicy.BEST_EFFORT
        )
        if best == self._reliability:
            return
        if not self._matches_publisher:
            if self._reliability == ReliabilityPolicy.RELIABLE:
                self._node.get_logger().error(
                    f"{self.topic} is published with best effort, but qos:=1 asks for a reliable "
                    "subscription, which gets nothing from it; set qos to 0"
                )
            return
        self._node.get_logger().info(f"{self.topic}: subscribing {_words(best)}, as published")
        self._reliability = best
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._subscribe()

    @property
    def publishers(self) -> tuple[str, ...]:
        """Who publishes the topic, with its type where that is another, and its reliability."""
        words = []
        for info in self._node.get_publishers_info_by_topic(self.topic):
            name = f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            expected = self._type.__module__.split(".")[0] + "/msg/" + self._type.__name__
            wrong = "" if info.topic_type == expected else f"as {info.topic_type}, not {expected}, "
            words.append(f"{name} ({wrong}{_words(info.qos_profile.reliability)})")
        return tuple(words)


def _words(reliability: ReliabilityPolicy) -> str:
    return str(reliability.name).lower().replace("_", " ")


class OdometryNode(Node):  # type: ignore[misc]
    """RGB-D odometry as a node; a context manager, since it owns a thread.

    Attributes:
        monitor: counts what becomes of frames.
    """

    def __init__(self) -> None:
        """Declares the parameters; subscribes as soon as the first frame would not be slow.

        Raises:
            InputError: a parameter has a value that it cannot have.
        """
        super().__init__(NODE_NAME)
        self._log_handler = _RosLogHandler(self.get_logger())
        logging.getLogger(cfg.PACKAGE).addHandler(self._log_handler)

        self._node_config, odometry_config = self._declare_parameters()
        self._framing = frames.framing(
            self._node_config.frame_id,
            self._node_config.camera_pose,
            self._node_config.camera_axes,
        )
        self._config = odometry_config
        self._odometry = Odometry(odometry_config)
        self.monitor = Monitor()
        self._last_stamp_ns: int | None = None
        self._max_interval_ns = round(self._node_config.approx_sync_max_interval * NANOSECONDS)
        self._synchronizer: Synchronizer[Any] = Synchronizer(
            self._max_interval_ns, self._node_config.sync_queue_size
        )

        self._pose_publisher = self.create_publisher(PoseStamped, topics.POSE, 10)
        self._odom_publisher = self.create_publisher(OdometryMessage, topics.ODOM, 10)
        self._keyframe_publisher = self.create_publisher(PoseStamped, topics.KEYFRAME_POSE, 10)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, 10)
        self._worker = NewestWorker(self._process, lambda _: self.monitor.dropped(Drop.SUPERSEDED))
        self._inputs: list[_Subscribed] = []

        # not the node's clock: simulated time may stand still just when silence is to be reported
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._counts_at_last_look = self._counts()
        self._silence = ""
        self.create_timer(SILENCE_S, self._report_silence, clock=steady)
        self.create_timer(DIAGNOSTICS_S, self._publish_diagnostics, clock=steady)
        self._warmed_up = self.create_guard_condition(self._subscribe)
        # compiling for the first time takes long, and the process is to end when it is told to
        threading.Thread(target=self._warm_up, name="warm-up", daemon=True).start()

    def __enter__(self) -> OdometryNode:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Finishes the frame in work and ends the thread."""
        ended = self._worker.close(CLOSE_S)
        self.get_logger().info(str(self.monitor.summary(time.monotonic_ns())))
        logging.getLogger(cfg.PACKAGE).removeHandler(self._log_handler)
        if ended:
            self.destroy_node()

    # Parameters

    def _declare_parameters(self) -> tuple[cfg.NodeConfig, cfg.Config]:
        """Declares all parameters with the values that the overrides give them.

        Overrides are read before the declaration, which would refuse an int where a double is
        declared, take a misspelt name for nothing, and know no preset below them.
        """
        given = {name: item.value for name, item in self._parameter_overrides.items()}
        own = {p.name: p for p in cfg.parameters(cfg.NodeConfig())}
        method = {p.name: p for p in cfg.parameters(cfg.Config())}
        node_config = cfg.with_values(
            cfg.NodeConfig(), {name: value for name, value in given.items() if name in own}
        )
        odometry_config = cfg.with_values(
            cfg.load_preset(node_config.preset),
            {name: value for name, value in given.items() if name in method},
        )
        resolved = {**cfg.values(node_config), **cfg.values(odometry_config)}
        for parameter in [*own.values(), *method.values()]:
            self.declare_parameter(
                parameter.name,
                resolved[parameter.name],
                _descriptor(parameter),
                ignore_override=True,
            )
        for name in given:
            # rclpy declares some by itself, as use_sim_time
            if not self.has_parameter(name):
                self.get_logger().error(str(cfg.unknown_parameter(name, resolved)))
        return node_config, odometry_config

    # Input

    def _warm_up(self) -> None:
        self.get_logger().info("Warming up; where nothing is compiled yet, it takes some seconds")
        try:
            warm_up(self._config)
        except Exception:
            logger.exception("Warming up failed, so the first frames will be slow")
        with contextlib.suppress(InvalidHandle):  # the node has ended meanwhile
            self._warmed_up.trigger()

    def _subscribe(self) -> None:
        transports = {
            Channel.COLOR: self._node_config.image_transport,
            Channel.DEPTH: self._node_config.depth_transport,
            Channel.INFO: topics.RAW,
        }
        for channel, transport in transports.items():
            if channel is Channel.INFO:
                message_type: type = CameraInfo
            else:
                message_type = Image if transport == topics.RAW else CompressedImage
            # as image_transport does it: what users remap is the base topic
            topic = topics.transported(
                self.resolve_topic_name(topics.SUBSCRIBED[channel]), transport
            )
            self._inputs.append(
                _Subscribed(self, channel, message_type, topic, self._receive, self._node_config)
            )
        self.get_logger().info(self._description())

    def _frame(self, match: Match[Any]) -> RgbdFrame:
        color, depth, info = (i.topic for i in self._inputs)
        names = messages.FrameTopics(color, depth, info)
        return messages.frame_from_messages(match.color, match.depth, match.info, names)

    def _receive(self, channel: Channel, message: Any) -> None:
        arrived_ns = time.monotonic_ns()
        stamp_ns = messages.stamp_ns(message.header.stamp)
        for match in self._synchronizer.add(channel, stamp_ns, message):
            self._worker.submit(_Arrival(match, arrived_ns))

    # Work, on the worker's thread

    def _process(self, arrival: _Arrival) -> None:
        state_before = self._odometry.state
        try:
            frame = self._frame(arrival.match)
            self._reset_if_earlier(frame)
            estimate = self._odometry.process(frame)
            self._publish(estimate, frame.frame_id)
        except InputError as fault:
            self.monitor.dropped(Drop.UNUSABLE)
            if self.monitor.is_news(fault.where, fault.cause):
                self.get_logger().error(f"{fault} (said once, counted from now on)")
            return
        except Exception as error:
            self.monitor.dropped(Drop.FAILED)
            if self.monitor.is_news("a frame", repr(error)):
                logger.exception("The frame at %d ns failed; going on", arrival.match.stamp_ns)
            return
        self.monitor.processed(estimate, arrival.arrived_ns, time.monotonic_ns())
        self._announce(state_before, estimate)

    def _reset_if_earlier(self, frame: RgbdFrame) -> None:
        """Starts anew when time went back; ``Match.restarted`` may have been superseded."""
        if self._last_stamp_ns is not None and frame.stamp_ns < self._last_stamp_ns:
            back_s = (self._last_stamp_ns - frame.stamp_ns) / NANOSECONDS
            self.get_logger().warning(
                f"Time went back by {back_s:.3f} s (a bag in a loop?): starting anew"
            )
            self._odometry.reset()
        self._last_stamp_ns = frame.stamp_ns

    def _publish(self, estimate: OdometryEstimate, frame_id: str) -> None:
        """Publishes what the estimate knows, and nothing that it does not."""
        if estimate.T_odom_camera is None:
            return
        head = message_fields.header(estimate.stamp_ns, self._node_config.odom_frame_id)
        pose = message_fields.copy_fields(
            message_fields.pose_stamped(self._framing.pose(estimate.T_odom_camera), head),
            PoseStamped(),
        )
        self._pose_publisher.publish(pose)
        if estimate.is_keyframe:
            self._keyframe_publisher.publish(pose)
        if (
            estimate.covariance is None
            or estimate.twist is None
            or estimate.twist_covariance is None
        ):
            return  # the first frame has no velocity, and a made-up one would be believed
        odom = OdometryMessage(header=pose.header)
        odom.child_frame_id = self._node_config.frame_id or frame_id
        odom.pose.pose = pose.pose
        odom.pose.covariance = self._framing.pose_covariance(
            estimate.T_odom_camera, estimate.covariance
        ).ravel()
        odom.twist.twist = _twist_message(self._framing.twist(estimate.twist))
        odom.twist.covariance = self._framing.twist_covariance(estimate.twist_covariance).ravel()
        self._odom_publisher.publish(odom)

    def _announce(self, before: TrackingState, estimate: OdometryEstimate) -> None:
        if estimate.state is before:
            return
        if estimate.state is TrackingState.LOST:
            result = estimate.registration
            reason = f" ({result.status.value})" if result else ""
            self.get_logger().warning(
                f"Lost at {estimate.stamp_ns / NANOSECONDS:.3f}{reason}: no pose is published "
                "until the camera is found again"
            )
        elif before is TrackingState.LOST:
            self.get_logger().info(f"Tracking again at {estimate.stamp_ns / NANOSECONDS:.3f}")

    # Reports

    def _counts(self) -> tuple[int, dict[Channel, int]]:
        """Complete frames, and messages of each channel, so far."""
        counts = self._synchronizer.counts
        return self._synchronizer.matches, {c: counts[c].received for c in Channel}

    def _report_silence(self) -> None:
        matches, received = self._counts()
        matches_before, received_before = self._counts_at_last_look
        self._counts_at_last_look = matches, received
        if matches > matches_before or not self._inputs:
            self._silence = ""
            return
        inputs = [
            Input(
                i.channel,
                i.topic,
                i.publishers,
                received[i.channel] - received_before[i.channel],
            )
            for i in self._inputs
        ]
        why = explain_silence(inputs, self._synchronizer.closest_miss_ns, self._max_interval_ns)
        if why != self._silence:
            self.get_logger().warning(f"No frame for {SILENCE_S:.0f} s: {why}")
        self._silence = why

    def _publish_diagnostics(self) -> None:
        summary = self.monitor.summary(time.monotonic_ns())
        values: dict[str, object] = {**summary.values()}
        for channel, counts in self._synchronizer.counts.items():
            values |= {f"{channel.value}: {name}": n for name, n in asdict(counts).items()}
        status = DiagnosticStatus(
            level=DiagnosticStatus.STALE if self._silence else DIAGNOSTIC_LEVELS[summary.state],
            name=f"{self.get_fully_qualified_name()}: odometry",
            message=self._silence or summary.state.value,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        header = Header(stamp=self.get_clock().now().to_msg())
        self._diagnostics_publisher.publish(DiagnosticArray(header=header, status=[status]))

    def _description(self) -> str:
        """What is subscribed and published, in the frames as the user would check them."""
        subscribed = ", ".join(i.topic for i in self._inputs)
        child = self._node_config.frame_id or "the camera's optical frame"
        x, y, z = self._framing.T_odom_c0[:3, 3]
        ahead, up = self._framing.T_odom_c0[:3, 2], -self._framing.T_odom_c0[:3, 1]
        return (
            f"Subscribed to {subscribed}; publishing {self._node_config.odom_frame_id} -> {child}. "
            f"At the start the camera is at ({x:.3f} {y:.3f} {z:.3f}) in "
            f"{self._node_config.odom_frame_id}, looks along ({_vector(ahead)}), "
            f"and its image's top is towards ({_vector(up)})"
        )


class _RosLogHandler(logging.Handler):
    """Sends what the library logs to the node's logger, and so to /rosout."""

    def __init__(self, logger: Any) -> None:
        super().__init__(logging.INFO)
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        """Logs a record; each severity from a line of its own, as rclpy demands."""
        text = self.format(record)
        if record.levelno >= logging.ERROR:
            self._logger.error(text)
        elif record.levelno >= logging.WARNING:
            self._logger.warning(text)
        else:
            self._logger.info(text)


def _descriptor(parameter: cfg.Parameter) -> ParameterDescriptor:
    """The declaration of a parameter, as ROS tells it; all are read once, at the start."""
    descriptor = ParameterDescriptor(
        name=parameter.name,
        description=parameter.description,
        additional_constraints=f"Takes {parameter.allowed}.",
        read_only=True,
    )
    low, high = parameter.minimum, parameter.maximum
    if parameter.type is int and (low, high) != (None, None):
        descriptor.integer_range = [
            IntegerRange(
                from_value=-(2**63) if low is None else int(low),
                to_value=2**63 - 1 if high is None else int(high),
            )
        ]
    elif parameter.type is float and (low, high) != (None, None):
        descriptor.floating_point_range = [
            FloatingPointRange(
                from_value=-sys.float_info.max if low is None else float(low),
                to_value=sys.float_info.max if high is None else float(high),
            )
        ]
    return descriptor


def _twist_message(velocity: Float64) -> Twist:
    twist = Twist()
    for part, (x, y, z) in ((twist.linear, velocity[:3]), (twist.angular, velocity[3:])):
        part.x, part.y, part.z = float(x), float(y), float(z)
    return twist


def _vector(v: Float64) -> str:
    return " ".join(f"{x + 0.0:.2f}" for x in v)


class _Executor(SingleThreadedExecutor):  # type: ignore[misc]
    """Goes on after an exception, as of a message that cannot be deserialised."""

    def __init__(self, node: OdometryNode) -> None:
        super().__init__()
        self.add_node(node)
        self._is_news = node.monitor.is_news

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Runs one callback."""
        try:
            super().spin_once(timeout_sec)
        except Exception as error:
            if self._is_news("a callback", repr(error)):
                logger.exception("A callback failed; going on")


def _init(args: list[str] | None) -> None:
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except (RCLError, UnknownROSArgsError) as error:
        # what follows are places in rcl's source
        cause = str(error).partition(", at /")[0]
        raise InputError("ROS arguments", cause, "give --ros-args -p name:=value") from error


def main(args: list[str] | None = None) -> int:
    """Runs the node until SIGINT or SIGTERM.

    Returns:
        The exit code: 0, or 2 when an argument or parameter has a value that it cannot have.
    """
    # not rclpy's handlers, which take the context away from a frame that is still in work
    told_to_end = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: told_to_end.set())
    try:
        _init(args)
        with OdometryNode() as node:
            executor = _Executor(node)
            spinning = threading.Thread(target=executor.spin, daemon=True)
            spinning.start()
            told_to_end.wait()
            executor.shutdown()
            spinning.join()
    except InputError as error:
        rclpy.logging.get_logger(NODE_NAME).fatal(str(error))
        return 2
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
