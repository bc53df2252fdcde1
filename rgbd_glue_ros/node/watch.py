"""A node that watches the odometry node: what it publishes, and why it does not."""

from __future__ import annotations

import os
import time
from typing import Any, Protocol

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.clock import Clock, ClockType

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.end_signals import EndSignals
from rgbd_glue_ros.live.first_publishers import FirstPublishers, Silence
from rgbd_glue_ros.live.mixture import Mixture
from rgbd_glue_ros.live.odometry_faults import OdometryTopic, describe_network, explain_no_poses
from rgbd_glue_ros.live.watched_odometry import Report, WatchedOdometry
from rgbd_glue_ros.live.watched_poses import ReceivedPose
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.node.diagnostics import PART
from rgbd_glue_ros.node.publishers import describe_mixture, describe_publishers, message_number
from rgbd_glue_ros.node.runtime import GiveUp, run_node
from rgbd_glue_ros.printable import counted
from rgbd_glue_ros.trajectories.recorder import PoseRecorder
from rgbd_glue_ros.types import NANOSECONDS

NODE_NAME = "rgbd_watch"
# Period of the checks; DDS finds a publisher within a second.
LOOK_S = 2.0
# No pose may be lost while the terminal is slow, since they are recorded.
_QUEUE_SIZE = 1000
# A node says its state once a second.
_HEARD_NS = 3 * NANOSECONDS


class Screen(Protocol):
    """Where the state is shown.

    Attributes:
        period_s: how often.
    """

    period_s: float

    def show(self, line: str, reason: str) -> None:
        """Shows state and pose, and what is wrong; "" if nothing is."""

    def say(self, line: str) -> None:
        """Shows a line that stays."""


class WatchNode(BaseNode):
    """Shows the poses and the state of an odometry node, and records the poses."""

    def __init__(self, give_up: GiveUp, screen: Screen, recorder: PoseRecorder | None) -> None:
        """Subscribes.

        Args:
            give_up: called if the screen is gone, or the record cannot be written.
            screen: where the state is shown.
            recorder: takes all poses; None for none.
        """
        super().__init__(NODE_NAME)
        self._give_up = give_up
        self._screen = screen
        self._recorder = recorder
        self._odometry = WatchedOdometry()
        self._first = FirstPublishers()
        self._mixture = Mixture()
        self._received = self._received_before = 0
        self._heard_of: dict[str, int] = {}
        self._topic = self.resolve_topic_name(topics.ODOM)
        self.create_subscription(OdometryMessage, topics.ODOM, self._take, _QUEUE_SIZE)
        self.create_subscription(DiagnosticArray, topics.DIAGNOSTICS, self._take_diagnostics, 10)
        # not the node's clock, since simulated time may stand still
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(screen.period_s, self._show, clock=steady)
        self.create_timer(LOOK_S, self._look, clock=steady)
        kept = "" if recorder is None else f", recording to {recorder.path}"
        screen.say(f"watching {self._topic}{kept}; Ctrl-C ends it")

    def _finish(self) -> bool:
        """Says what there was."""
        path_m, count = self._odometry.poses.path_m, self._odometry.count
        said = f"{counted(count, 'pose')}, path {path_m:.1f} m" if count else "no pose came"
        if self._recorder is not None:
            kept = self._recorder.count
            said += f"; {counted(kept, 'pose')} in {self._recorder.path}" if kept else ", no file"
        self._on_screen(said)
        return True

    def _take(self, message: OdometryMessage, info: dict[str, Any]) -> None:
        self._received += 1
        at_ns = stamp_ns(message.header.stamp)
        self._mixture.add(message_number(info))
        if not self._odometry.follows(at_ns, message_number(info)):
            self._on_screen("the odometry began anew")
            if self._recorder is not None:
                self._recorder.begin_anew()
        if _is_null(message):
            return
        T_odom_child = pose_from_message(message, self._topic)
        latency_ns = self.get_clock().now().nanoseconds - at_ns
        pose = ReceivedPose(at_ns, T_odom_child, time.monotonic_ns(), latency_ns)
        self._odometry.take_pose(pose)
        if self._recorder is None:
            return
        try:
            self._recorder.append(at_ns, T_odom_child)
        except InputError as fault:
            self._give_up(fault)

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        now_ns = time.monotonic_ns()
        publishers = {
            topics.full_name(info.node_namespace, info.node_name)
            for info in self.get_publishers_info_by_topic(self._topic)
        }
        for status in message.status:
            name, _, part = status.name.rpartition(": ")
            if part != PART:
                continue
            values = {item.key: item.value for item in status.values}
            is_stale = status.level == DiagnosticStatus.STALE
            report = Report.parse(status.message, values, now_ns, is_stale=is_stale)
            if report is None:
                continue
            if name in publishers:
                self._odometry.take_report(report)
            else:
                self._heard_of[name] = now_ns

    def _look(self) -> None:
        """Finds out why nothing arrives."""
        publishers = describe_publishers(self, self._topic, OdometryMessage)
        lately = self._received - self._received_before
        self._received_before = self._received
        verdict = self._first.judge(has_publishers=bool(publishers), has_messages=lately > 0)
        is_mixed = self._mixture.judge(len(publishers))
        self._odometry.doubt = describe_mixture(self._topic, publishers) if is_mixed else ""
        if lately or verdict is Silence.TOO_EARLY:
            return
        now_ns = time.monotonic_ns()
        heard_of = [name for name, ns in self._heard_of.items() if now_ns - ns < _HEARD_NS]
        self._odometry.silence = explain_no_poses(
            OdometryTopic(self._topic, publishers, lately),
            heard_of,
            describe_network(os.environ),
            was_there=self._odometry.count > 0,
        )

    def _show(self) -> None:
        now_ns = time.monotonic_ns()
        try:
            self._screen.show(self._odometry.line(now_ns), self._odometry.reason(now_ns))
        except OSError:
            self._give_up()

    def _on_screen(self, line: str) -> None:
        try:
            self._screen.say(line)
        except OSError:
            self._give_up()


def _is_null(message: OdometryMessage) -> bool:
    """Whether it stands for a frame without a pose (``publish_null_when_lost``)."""
    q = message.pose.pose.orientation
    return not any((q.x, q.y, q.z, q.w))


def main(
    args: list[str] | None = None,
    end_signals: EndSignals | None = None,
    *,
    screen: Screen,
    recorder: PoseRecorder | None = None,
) -> int:
    """Watches until a signal ends it; arguments and exit code as for the odometry node."""
    return run_node(
        NODE_NAME, lambda give_up: WatchNode(give_up, screen, recorder), args, end_signals
    )
