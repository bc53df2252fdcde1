"""What the node tells of itself: /diagnostics, and a line when nothing arrives."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import Header

from rgbd_glue_ros import topics
from rgbd_glue_ros.monitor import Input, Monitor, explain_silence
from rgbd_glue_ros.node_inputs import NodeInput
from rgbd_glue_ros.sync import Channel, Synchronizer
from rgbd_glue_ros.types import TrackingState

DIAGNOSTIC_LEVELS = {
    TrackingState.INITIALIZING: DiagnosticStatus.WARN,
    TrackingState.TRACKING: DiagnosticStatus.OK,
    TrackingState.LOST: DiagnosticStatus.ERROR,
}
SILENCE_S = 5.0
DIAGNOSTICS_S = 1.0


class NodeDiagnostics:
    """Publishes the counts once a second, and says why no frame comes."""

    def __init__(
        self,
        node: Node,
        monitor: Monitor,
        synchronizer: Synchronizer[Any],
        inputs: Sequence[NodeInput],
    ) -> None:
        """Starts the timers.

        Args:
            node: whose diagnostics these are.
            monitor: counts frames.
            synchronizer: counts messages.
            inputs: the subscriptions; may be filled later.
        """
        self._node = node
        self._monitor = monitor
        self._synchronizer = synchronizer
        self._inputs = inputs
        self._publisher = node.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, 10)
        self._counts_at_last_look = self._counts()
        self._silence = ""
        # not the node's clock: simulated time may stand still just when silence is to be reported
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(SILENCE_S, self._report_silence, clock=steady)
        node.create_timer(DIAGNOSTICS_S, self._publish, clock=steady)

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
        why = explain_silence(
            inputs, self._synchronizer.closest_miss_ns, self._synchronizer.max_interval_ns
        )
        if why != self._silence:
            self._node.get_logger().warning(f"No frame for {SILENCE_S:.0f} s: {why}")
        self._silence = why

    def _verdict(self, state: TrackingState) -> tuple[bytes, str]:
        if self._monitor.is_paused:
            return DiagnosticStatus.WARN, "paused"
        if self._silence:
            return DiagnosticStatus.STALE, self._silence
        return DIAGNOSTIC_LEVELS[state], state.value

    def _publish(self) -> None:
        summary = self._monitor.summary(time.monotonic_ns())
        values: dict[str, object] = {**summary.values()}
        for channel, counts in self._synchronizer.counts.items():
            values |= {f"{channel.value}: {name}": n for name, n in asdict(counts).items()}
        level, message = self._verdict(summary.state)
        status = DiagnosticStatus(
            level=level,
            name=f"{self._node.get_fully_qualified_name()}: odometry",
            message=message,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        header = Header(stamp=self._node.get_clock().now().to_msg())
        self._publisher.publish(DiagnosticArray(header=header, status=[status]))
