"""The mapping node's state on /diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType

from rgbd_glue_ros.live import topics
from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.node.diagnostics import DIAGNOSTICS_S, diagnostics_message
from rgbd_glue_ros.node.input_watch import InputWatch
from rgbd_glue_ros.slam.live_map import LiveMap
from rgbd_glue_ros.types import NANOSECONDS


class MappingDiagnostics:
    """Publishes the state of the map once a second."""

    def __init__(
        self, node: BaseNode, live_map: LiveMap, watch: InputWatch, waiting: Callable[[], int]
    ) -> None:
        """Starts the timer.

        Args:
            node: whose diagnostics these are.
            live_map: the map.
            watch: knows whether images are missing.
            waiting: returns how many keyframes and edges have not been compared with the map yet.
        """
        self._node = node
        self._map = live_map
        self._watch = watch
        self._waiting = waiting
        self._mapped_ns: int | None = None
        self._publisher = node.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, 10)
        # not the node's clock, since simulated time may stand still
        node.create_timer(
            DIAGNOSTICS_S, self._publish, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def mapped(self) -> None:
        """Takes note that a keyframe has been added or located; any thread may call it."""
        self._mapped_ns = time.monotonic_ns()

    def _verdict(self) -> tuple[bytes, str]:
        if self._watch.silence:
            return DiagnosticStatus.STALE, self._watch.silence
        if not self._map.is_placed:
            return DiagnosticStatus.WARN, "no place of the map has been recognised yet"
        return DiagnosticStatus.OK, "mapping"

    def _publish(self) -> None:
        level, message = self._verdict()
        mapped_ns = self._mapped_ns
        age = "" if mapped_ns is None else f"{(time.monotonic_ns() - mapped_ns) / NANOSECONDS:.3f}"
        values = {
            "is_placed": str(self._map.is_placed).lower(),
            "keyframes": len(self._map.poses),
            "loops": self._map.loops,
            "waiting": self._waiting(),
            "waiting_for_known_place": self._map.waiting_keyframes,
            "since_last_keyframe_s": age,
            "last_error": self._node.monitor.last_error,
        }
        self._publisher.publish(diagnostics_message(self._node, "mapping", level, message, values))
