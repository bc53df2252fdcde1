"""The node's state on /diagnostics."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import Header

from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.monitor import Monitor
from rgbd_glue_ros.messages.synchronizer import Synchronizer
from rgbd_glue_ros.node.input_watch import InputWatch
from rgbd_glue_ros.printable import printable
from rgbd_glue_ros.types import NANOSECONDS, TrackingState

DIAGNOSTIC_LEVELS = {
    TrackingState.INITIALIZING: DiagnosticStatus.WARN,
    TrackingState.TRACKING: DiagnosticStatus.OK,
    TrackingState.LOST: DiagnosticStatus.ERROR,
}
PART = "odometry"
"""What a status is of that ``NodeDiagnostics`` publishes."""

DIAGNOSTICS_S = 1.0
LOG_S = 60.0


def diagnostics_message(
    node: Node, part: str, level: bytes, message: str, values: Mapping[str, object]
) -> DiagnosticArray:
    """The message with the state of a node.

    Args:
        node: the node, whose clock gives the stamp.
        part: what of the node the state is of, in one word.
        level: a level of DiagnosticStatus.
        message: the state in one line.
        values: further values by name.
    """
    status = DiagnosticStatus(
        level=level,
        name=f"{node.get_fully_qualified_name()}: {part}",
        message=printable(message),
        values=[KeyValue(key=key, value=printable(str(v))) for key, v in values.items()],
    )
    header = Header(stamp=node.get_clock().now().to_msg())
    return DiagnosticArray(header=header, status=[status])


class NodeDiagnostics:
    """Publishes state and counts once a second, and logs a summary once a minute."""

    def __init__(
        self,
        node: Node,
        monitor: Monitor,
        synchronizer: Synchronizer[Any],
        watch: InputWatch,
    ) -> None:
        """Starts the timers.

        Args:
            node: whose diagnostics these are.
            monitor: counts frames.
            synchronizer: counts messages.
            watch: knows whether input is missing.
        """
        self._node = node
        self._monitor = monitor
        self._synchronizer = synchronizer
        self._watch = watch
        self._publisher = node.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, 10)
        # not the node's clock, since simulated time may stand still
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(DIAGNOSTICS_S, self._publish, clock=steady)
        node.create_timer(LOG_S, self._log, clock=steady)

    def _verdict(self, state: TrackingState, now_ns: int) -> tuple[bytes, str]:
        if self._monitor.is_paused:
            return DiagnosticStatus.WARN, "paused"
        if self._watch.silence:
            return DiagnosticStatus.STALE, self._watch.silence
        refused = self._monitor.why_refused(now_ns)
        if refused:
            return DiagnosticStatus.ERROR, refused
        if state is TrackingState.TRACKING and self._monitor.is_overdue(now_ns):
            seconds = self._monitor.without_pose_ns(now_ns) / NANOSECONDS
            return DiagnosticStatus.STALE, f"no frame for {seconds:.0f} s"
        monitor = self._monitor
        doubted = (monitor.restarts.doubt, monitor.unseen_motion.doubt)
        doubts = [line for line in (*doubted, monitor.guess_fault, self._watch.drops) if line]
        if state is TrackingState.TRACKING and doubts:
            return DiagnosticStatus.WARN, "; ".join(doubts)
        why = self._monitor.preparing or self._monitor.why_no_pose
        return DIAGNOSTIC_LEVELS[state], f"{state.value}: {why}" if why else state.value

    def _log(self) -> None:
        """Logs rate, latency and drops."""
        summary = self._monitor.summary(time.monotonic_ns())
        if summary.frames or any(summary.drops.values()):
            self._node.get_logger().info(f"{summary.rate_hz:.1f} poses per second; {summary}")

    def _publish(self) -> None:
        now_ns = time.monotonic_ns()  # once, so that level and values agree
        values: dict[str, object] = {**self._monitor.values(now_ns)}
        for channel, counts in self._synchronizer.counts.items():
            values |= {f"{channel.value}: {name}": n for name, n in asdict(counts).items()}
        level, message = self._verdict(self._monitor.state, now_ns)
        self._publisher.publish(diagnostics_message(self._node, PART, level, message, values))
